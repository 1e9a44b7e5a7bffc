"""The law of `bikeFE` in parts, and the mistakes that students make in it.

The scores come from `bike_model.bikeFE`. This law only names mistakes; a test compares both.
"""

from __future__ import annotations

from itertools import chain, permutations

from barc_sim.lab.check.laws import Law, read
from barc_sim.vehicle.bike_model import GRAVITY, Vehicle

EQUATIONS = ('x', 'y', 'psi', 'v')  #: in the order of what bikeFE returns

_RIGHT = {
    'g': f'{GRAVITY}',
    'beta': 'atan(l_r / (l_f + l_r) * tan(d_f))',
    'course': 'psi + beta',
    'v_course': 'v',  # the speed that moves x and y
    'v_turn': 'v',  # the speed that turns psi
    'x_rate': 'v_course * cos(course)',
    'y_rate': 'v_course * sin(course)',
    'psi_rate': 'v_turn / l_r * sin(beta)',
    'gravity': '-m * g * sin(theta)',
    'drag': '-a0 * v**2 * sign(v)',
    'friction': '-Ff * sign(v)',
    'force': 'gravity + drag + friction',
    'v_rate': 'a + force / m',
    # Each equation has its own ts and old value, so that a mistake can change one of them.
    **{f'{name}_ts': 'ts' for name in EQUATIONS},
    **{f'{name}_old': name for name in EQUATIONS},
    **{f'{name}_next': f'{name}_old + {name}_ts * {name}_rate' for name in EQUATIONS},
}

_LAB = Vehicle()
_BETA = f'beta = {_RIGHT["beta"]}'
_TURN = 'v / l_r * sin(beta)'
_RESISTANCE = '(a0 * v**2 + Ff) * sign(v)'
_F_EXT = f'F_ext = -m * g * sin(theta) - {_RESISTANCE}'
_V_NEXT = 'v_next = v + ts * (a + F_ext / m)'
_BACKWARDS = {
    'x': 'x moves backwards: is its sign right?',
    'y': 'y moves backwards: is its sign right?',
    'psi': 'psi grows the wrong way for a left turn (d_f > 0): is its sign right?',
    'v': 'v falls when it must grow: is the sign of ts * (a + F_ext / m) right?',
}

_ORDER = ''.join(
    f"""
{other}_next is returned in place of {name}_next: the order is [x_next, y_next, psi_next, v_next]
    {name}_next = {other}_next"""
    for name, other in permutations(EQUATIONS, 2)
)

_INTEGRATION = ''.join(
    f"""
{name} does not change: is {name}_next computed, and returned?
    {name}_next = {name}
{name}_next is always 0: is it computed, and returned?
    {name}_next = 0 * {name}
ts is missing in {name}_next
    {name}_ts = 1
ts is in {name}_next twice
    {name}_ts = ts**2
ts is always 0.02 in {name}_next: use the argument of bikeFE
    {name}_ts = 0.02
the old {name} is missing: {name}_next = {name} + ts * (its rate of change)
    {name}_old = 0
the rate of change is returned in place of {name}_next = {name} + ts * rate
    {name}_next = {name}_rate
{_BACKWARDS[name]}
    {name}_ts = -ts
the car moves forward in {name} when it reverses: keep the sign of v
    {name}_rate = sign(v) * ({_RIGHT[f'{name}_rate']})"""
    for name in EQUATIONS
)


def _wrong_unit(angle: str) -> str:
    return f"""
{angle} arrives in radians: is it converted from degrees once more?
    {angle} = radians({angle})
{angle} is converted to degrees: it arrives in radians, which sin, cos and tan take
    {angle} = degrees({angle})"""


_STEERING = f"""
psi grows the wrong way for a left turn (d_f > 0): is the sign of beta right?
    beta = -atan(l_r / (l_f + l_r) * tan(d_f))
beta is as large as d_f: is l_r / (l_f + l_r) missing in {_BETA}?
    beta = d_f
l_f is used in place of l_r, in {_BETA} and in {_TURN}
    beta = atan(l_f / (l_f + l_r) * tan(d_f))
    psi_rate = v_turn / l_f * sin(beta)
l_f is used in place of l_r in {_BETA}
    beta = atan(l_f / (l_f + l_r) * tan(d_f))
atan is missing in {_BETA}
    beta = l_r / (l_f + l_r) * tan(d_f)
tan is missing in {_BETA}
    beta = atan(l_r / (l_f + l_r) * d_f)
atan and tan are missing in {_BETA}: small angles only
    beta = 0.5 * d_f
tan is used in place of atan in {_BETA}
    beta = tan(l_r / (l_f + l_r) * tan(d_f))
atan is used in place of tan in {_BETA}
    beta = atan(l_r / (l_f + l_r) * atan(d_f))
sin is used in place of tan in {_BETA}
    beta = atan(l_r / (l_f + l_r) * sin(d_f))
the ratio of lengths is upside down: {_BETA}
    beta = atan((l_f + l_r) / l_r * tan(d_f))
the brackets around l_f + l_r are missing in {_BETA}
    beta = atan((l_r / l_f + l_r) * tan(d_f))
the brackets around l_f + l_r are missing in {_BETA}
    beta = atan(l_r / l_f + l_r * tan(d_f))
beta is in degrees, but sin and cos take radians
    beta = degrees(atan(l_r / (l_f + l_r) * tan(d_f)))
d_f has no effect: is beta zero?
    beta = 0
{_wrong_unit('d_f')}"""

_COURSE = f"""
beta is missing in x and y: the car moves in the direction psi + beta, not psi
    course = psi
x and y move in the direction psi - beta: is the sign of beta right in psi + beta?
    course = psi - beta
the brackets around psi + beta are missing
    x_rate = v_course * (cos(psi) + beta)
    y_rate = v_course * (sin(psi) + beta)
psi is missing in x and y: the car moves in the direction psi + beta, not beta
    course = beta
beta is added twice in x and y: the car moves in the direction psi + beta
    course = psi + 2 * beta
sin and cos are swapped: x goes with cos(psi + beta), y with sin(psi + beta)
    x_rate = v_course * sin(course)
    y_rate = v_course * cos(course)
the new v is used for x, y or psi: forward Euler computes all of them from the old v
    v_course = v_next
    v_turn = v_next
the new psi is used for x or y: forward Euler computes all of them from the old psi
    course = psi_next + beta
d_f is used in place of beta in psi + beta
    course = psi + d_f
{_wrong_unit('psi')}"""

_TURNING = f"""
l_f is used in place of l_r in {_TURN}
    psi_rate = v_turn / l_f * sin(beta)
l_r is missing in psi_next = psi + ts * {_TURN}
    psi_rate = v_turn * sin(beta)
psi is divided by l_f + l_r; {_TURN} has l_r alone
    psi_rate = v_turn / (l_f + l_r) * sin(beta)
psi is multiplied by l_r; {_TURN} divides by it
    psi_rate = v_turn * l_r * sin(beta)
psi is that of the rear axle, v / (l_f + l_r) * tan(d_f), or tan is used in place of sin in {_TURN}
    psi_rate = v_turn / l_r * tan(beta)
cos is used in place of sin in {_TURN}
    psi_rate = v_turn / l_r * cos(beta)
sin is missing in {_TURN}
    psi_rate = v_turn / l_r * beta
d_f is used in place of beta in {_TURN}
    psi_rate = v_turn / l_r * sin(d_f)
psi is used in place of beta in {_TURN}
    psi_rate = v_turn / l_r * sin(psi)
psi + beta is used in place of beta in {_TURN}
    psi_rate = v_turn / l_r * sin(psi + beta)
psi has no speed in it: psi_next = psi + ts * {_TURN}
    psi_rate = sin(beta) / l_r"""

_SPEED = f"""
drag, friction and gravity are missing: {_V_NEXT}
    force = 0
air drag is missing: F_ext includes -a0 * v**2 * sign(v)
    drag = 0
rolling friction is missing: F_ext includes -Ff * sign(v)
    friction = 0
gravity is missing: F_ext includes -m * g * sin(theta)
    gravity = 0
air drag and rolling friction are missing in F_ext
    drag = 0
    friction = 0
drag and friction push the car on when it reverses: they act against the motion, -{_RESISTANCE}
    drag = -a0 * v**2
    friction = -Ff
drag pushes the car on when it reverses: it acts against the motion, -a0 * v**2 * sign(v)
    drag = -a0 * v**2
friction pushes the car on when it reverses: it acts against the motion, -Ff * sign(v)
    friction = -Ff
drag grows with v; it must grow with v**2: -a0 * v**2 * sign(v)
    drag = -a0 * v
drag grows with v; it must grow with v**2: -a0 * v**2 * sign(v)
    drag = -a0 * v * sign(v)
drag is half of the right value: a0 includes all factors, -a0 * v**2 * sign(v)
    drag = -0.5 * a0 * v**2 * sign(v)
abs(v) is used in place of sign(v): drag and friction are -{_RESISTANCE}
    drag = -a0 * v**2 * abs(v)
    friction = -Ff * abs(v)
abs(v) is used in place of sign(v) in drag: it is -a0 * v**2 * sign(v)
    drag = -a0 * v**2 * abs(v)
abs(v) is used in place of sign(v) in friction: it is -Ff * sign(v)
    friction = -Ff * abs(v)
drag and friction speed the car up: are their signs right?
    drag = a0 * v**2 * sign(v)
    friction = Ff * sign(v)
drag speeds the car up: is its sign right?
    drag = a0 * v**2 * sign(v)
friction speeds the car up: is its sign right?
    friction = Ff * sign(v)
friction is multiplied by the weight: Ff is already a force in newtons
    friction = -Ff * m * g * sign(v)
drag is multiplied by m: it is -a0 * v**2 * sign(v)
    drag = -m * a0 * v**2 * sign(v)
drag and friction are not divided by m: {_V_NEXT}
    drag = -a0 * v**2 * sign(v) * m
    friction = -Ff * sign(v) * m
cos is used in place of sin in gravity: -m * g * sin(theta)
    gravity = -m * g * cos(theta)
gravity speeds the car up uphill (theta > 0): is its sign right?
    gravity = m * g * sin(theta)
tan is used in place of sin in gravity: -m * g * sin(theta)
    gravity = -m * g * tan(theta)
sin is missing in gravity: -m * g * sin(theta)
    gravity = -m * g * theta
gravity acts on the flat, too: it is -m * g * sin(theta)
    gravity = -m * g
m and sin(theta) are missing in gravity: the force is -m * g * sin(theta)
    gravity = -g
m is missing in gravity: the force is -m * g * sin(theta)
    gravity = -g * sin(theta)
g is 9.81: the lab has {GRAVITY:g} m/s\N{SUPERSCRIPT TWO}
    g = 9.81
g is 9.80665: the lab has {GRAVITY:g} m/s\N{SUPERSCRIPT TWO}
    g = 9.80665
g is 10: the lab has {GRAVITY:g} m/s\N{SUPERSCRIPT TWO}
    g = 10
{_wrong_unit('theta')}
F_ext is not divided by m: {_V_NEXT}
    v_rate = a + force
a is divided by m: it is already an acceleration, {_V_NEXT}
    v_rate = (a + force) / m
F_ext is Ff alone: {_F_EXT}
    force = Ff
F_ext has the wrong sign: {_V_NEXT} with {_F_EXT}
    v_rate = a - force / m
half of ts is used in v_next: {_V_NEXT}
    v_ts = 0.5 * ts
the command a is missing: {_V_NEXT}
    v_rate = force / m
F_ext / m is not multiplied by ts: are the brackets missing in {_V_NEXT}?
    v_next = v_old + v_ts * a + force / m
v never falls below zero: the car can reverse
    v_next = maximum(v + ts * v_rate, 0)
v is never negative: the car can reverse, so use no abs
    v_next = abs(v + ts * v_rate)"""

_CONSTANTS = f"""
ts is always 0.01: use the argument of bikeFE, 0.02 s in the lab
    ts = 0.01
ts is always 0.1: use the argument of bikeFE, 0.02 s in the lab
    ts = 0.1
m is always {_LAB.mass:g}: use the argument of bikeFE
    m = {_LAB.mass}
a0 is always {_LAB.air_drag_coeff:g}: use the argument of bikeFE
    a0 = {_LAB.air_drag_coeff}
Ff is always {_LAB.friction:g}: use the argument of bikeFE
    Ff = {_LAB.friction}"""

#: By what they are about, the likelier ones first.
MISTAKES = {
    'Order': read(_ORDER),
    'Integration': read(_INTEGRATION),
    'Beta': read(_STEERING),
    'Course': read(_COURSE),
    'Turn': read(_TURNING),
    'Speed': read(_SPEED),
    'Constants': read(_CONSTANTS),
}
#: Inputs are the arguments of bikeFE with l_f and l_r; results are `x_next` to `v_next`.
BIKE = Law(_RIGHT, tuple(chain.from_iterable(MISTAKES.values())))
