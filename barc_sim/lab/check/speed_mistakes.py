"""Mistakes that are made with how fast the car goes: forces, mass and v."""

from __future__ import annotations

import numpy as np

from barc_sim.lab.check.mistake import Mistake, in_degrees, own, zero
from barc_sim.vehicle.bike_model import Vehicle

_LAB = Vehicle()

SPEED = (
    Mistake(
        'drag, friction and gravity are missing: v_next = v + ts * (a + F_ext / m)', zero('force')
    ),
    Mistake('air drag is missing: F_ext has -a0 * v**2 * sign(v) in it', zero('drag')),
    Mistake('rolling friction is missing: F_ext has -Ff * sign(v) in it', zero('friction')),
    Mistake('gravity is missing: F_ext has -m * g * sin(theta) in it', zero('gravity')),
    Mistake(
        'air drag and rolling friction are missing in F_ext',
        {**zero('drag'), **zero('friction')},
    ),
    Mistake(
        'drag and friction push the car on when it reverses: they act against the motion, '
        '-(a0 * v**2 + Ff) * sign(v)',
        {'drag': lambda q: -q.a0 * q.v**2, 'friction': lambda q: -q.Ff},
    ),
    Mistake(
        'drag pushes the car on when it reverses: it acts against the motion, -a0 * v**2 * sign(v)',
        {'drag': lambda q: -q.a0 * q.v**2},
    ),
    Mistake(
        'friction pushes the car on when it reverses: it acts against the motion, -Ff * sign(v)',
        {'friction': lambda q: -q.Ff},
    ),
    Mistake(
        'drag grows with v where it should with v**2: -a0 * v**2 * sign(v)',
        {'drag': lambda q: -q.a0 * q.v},
    ),
    Mistake(
        'drag is half of what it should be: a0 holds all factors, -a0 * v**2 * sign(v)',
        {'drag': lambda q: -0.5 * q.a0 * q.v * np.abs(q.v)},
    ),
    Mistake(
        'drag and friction speed the car up: are their signs right?',
        {'drag': lambda q: q.a0 * q.v * np.abs(q.v), 'friction': lambda q: q.Ff * np.sign(q.v)},
    ),
    Mistake(
        'drag speeds the car up: is its sign right?', {'drag': lambda q: q.a0 * q.v * np.abs(q.v)}
    ),
    Mistake(
        'friction speeds the car up: is its sign right?',
        {'friction': lambda q: q.Ff * np.sign(q.v)},
    ),
    Mistake(
        'friction is multiplied by the weight: Ff is a force in newtons already',
        {'friction': lambda q: -q.Ff * q.m * q.g * np.sign(q.v)},
    ),
    Mistake(
        'cos stands where sin belongs in gravity: -m * g * sin(theta)',
        {'gravity': lambda q: -q.m * q.g * np.cos(q.theta)},
    ),
    Mistake(
        'gravity speeds the car up uphill (theta > 0): is its sign right?',
        {'gravity': lambda q: q.m * q.g * np.sin(q.theta)},
    ),
    Mistake(
        'tan stands where sin belongs in gravity: -m * g * sin(theta)',
        {'gravity': lambda q: -q.m * q.g * np.tan(q.theta)},
    ),
    Mistake(
        'sin is missing in gravity: -m * g * sin(theta)',
        {'gravity': lambda q: -q.m * q.g * q.theta},
    ),
    Mistake(
        'm is missing in gravity: the force is -m * g * sin(theta)',
        {'gravity': lambda q: -q.g * np.sin(q.theta)},
    ),
    Mistake('g is 9.81: the lab has 9.8 m/s\N{SUPERSCRIPT TWO}', own('g', 9.81)),
    Mistake('g is 10: the lab has 9.8 m/s\N{SUPERSCRIPT TWO}', own('g', 10.0)),
    *in_degrees('theta'),
    Mistake(
        'F_ext is not divided by m: v_next = v + ts * (a + F_ext / m)',
        {'v_rate': lambda q: q.a + q.force},
    ),
    Mistake(
        'a is divided by m: it is an acceleration already, v_next = v + ts * (a + F_ext / m)',
        {'v_rate': lambda q: (q.a + q.force) / q.m},
    ),
    Mistake(
        'F_ext is subtracted: v_next = v + ts * (a + F_ext / m)',
        {'v_rate': lambda q: q.a - q.force / q.m},
    ),
    Mistake(
        'the command a is missing: v_next = v + ts * (a + F_ext / m)',
        {'v_rate': lambda q: q.force / q.m},
    ),
    Mistake(
        'v never goes below zero: the car can reverse',
        {'v_next': lambda q: np.maximum(q.v + q.ts * q.v_rate, 0.0)},
    ),
    *(
        Mistake(f'{name} is {value:g} whatever bikeFE is given: use the argument', own(name, value))
        for name, value in {
            'm': _LAB.mass,
            'a0': _LAB.air_drag_coeff,
            'Ff': _LAB.friction,
        }.items()
    ),
)
