import numpy as np

NAME = 'Ada Lovelace'
TS = 0.02


def command(t):
    if t < 7.0:
        return 2.0
    if t < 35.0:
        return 0.0
    k = int((t - 35.0) / 0.3 + 1e-9)
    return 2.0 * (1, -1, 1, 1, -1, -1, 1, -1)[k % 8]


def fit(t, v, a, delay):
    acted = np.interp(t - delay, np.append(t, t[-1] + TS), np.append(0.0, np.cumsum(a) * TS))
    acted[t < delay] = 0.0
    smooth = np.convolve(np.pad(v, 12, 'edge'), np.ones(25) / 25, 'valid')
    squares = np.append(0.0, np.cumsum(smooth**2)[:-1] * TS)
    moving = np.append(0.0, np.cumsum(acted > 0)[:-1] * TS)
    slopes = np.column_stack([-squares, -moving])
    found, *_ = np.linalg.lstsq(slopes, v - acted, rcond=None)
    return found, v - acted - slopes @ found, slopes


def estimate(t, v, a):
    t, v, a = np.array(t), np.array(v), np.array(a)
    delays = np.arange(0.0, 0.3, 0.002)
    costs = [np.sum(fit(t, v, a, d)[1] ** 2) for d in delays]
    k = int(np.clip(np.argmin(costs), 1, len(delays) - 2))
    p = np.polyfit(delays[k - 1 : k + 2] - delays[k], costs[k - 1 : k + 2], 2)
    delay = delays[k] - p[1] / (2 * p[0])
    (drag, friction), rest, slopes = fit(t, v, a, delay)
    ahead = (rest - fit(t, v, a, delay + 1e-3)[1]) / 1e-3
    slopes = np.column_stack([slopes, ahead])
    spread = np.sqrt(np.diag(np.linalg.inv(slopes.T @ slopes)) * np.mean(rest**2))
    half = 1.96 * spread
    return [drag, half[0], friction, half[1], delay, half[2]]
