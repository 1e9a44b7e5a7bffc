"""Common mistakes in the model's equations: of integration, steering and speed.

Each table has the hint of a mistake and, indented below it, the formulas that it changes.
"""

from __future__ import annotations

from barc_sim.lab.check.equations import EQUATIONS, NAMES, Mistake
from barc_sim.vehicle.bike_model import Vehicle


def _read(table: str) -> tuple[Mistake, ...]:
    """Return the mistakes of a table."""
    found: list[Mistake] = []
    for line in table.strip().splitlines():
        if line.startswith(' '):
            name, _, formula = line.strip().partition(' = ')
            found[-1].changes[name] = formula
        else:
            found.append(Mistake(line, {}))
    return tuple(found)


def _wrong_unit(angle: str) -> str:
    return f"""
{angle} arrives in radians: is it converted from degrees once more?
    {angle} = radians({angle})
{angle} is converted to degrees: it arrives in radians, which sin, cos and tan take
    {angle} = degrees({angle})
""".strip()


_BETA = 'beta = atan(l_r / (l_f + l_r) * tan(d_f))'
_TURN = 'v / l_r * sin(beta)'

BETA = _read(f"""
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
{_wrong_unit('d_f')}
""")

COURSE = _read(f"""
beta is missing in x and y: the car moves in the direction psi + beta, not psi
    course = psi
x and y move in the direction psi - beta: is the sign of beta right in psi + beta?
    course = psi - beta
psi is missing in x and y: the car moves in the direction psi + beta, not beta
    course = beta
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
{_wrong_unit('psi')}
""")

TURN = _read(f"""
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
psi has no speed in it: psi_next = psi + ts * {_TURN}
    psi_rate = sin(beta) / l_r
""")

_LAB = Vehicle()
_RESISTANCE = '(a0 * v**2 + Ff) * sign(v)'
_F_EXT = f'F_ext = -m * g * sin(theta) - {_RESISTANCE}'
_V_NEXT = 'v_next = v + ts * (a + F_ext / m)'

SPEED = _read(f"""
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
drag is half of the right value: a0 includes all factors, -a0 * v**2 * sign(v)
    drag = -0.5 * a0 * v * abs(v)
drag and friction speed the car up: are their signs right?
    drag = a0 * v * abs(v)
    friction = Ff * sign(v)
drag speeds the car up: is its sign right?
    drag = a0 * v * abs(v)
friction speeds the car up: is its sign right?
    friction = Ff * sign(v)
friction is multiplied by the weight: Ff is already a force in newtons
    friction = -Ff * m * g * sign(v)
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
g is 9.81: the lab has 9.8 m/s\N{SUPERSCRIPT TWO}
    g = 9.81
g is 10: the lab has 9.8 m/s\N{SUPERSCRIPT TWO}
    g = 10.0
{_wrong_unit('theta')}
F_ext is not divided by m: {_V_NEXT}
    v_rate = a + force
a is divided by m: it is already an acceleration, {_V_NEXT}
    v_rate = (a + force) / m
F_ext is Ff alone: {_F_EXT}
    force = Ff
F_ext has the wrong sign: {_V_NEXT} with {_F_EXT}
    v_rate = a - force / m
the command a is missing: {_V_NEXT}
    v_rate = force / m
v never falls below zero: the car can reverse
    v_next = maximum(v + ts * v_rate, 0.0)
m is always {_LAB.mass:g}: use the argument of bikeFE
    m = {_LAB.mass}
a0 is always {_LAB.air_drag_coeff:g}: use the argument of bikeFE
    a0 = {_LAB.air_drag_coeff}
Ff is always {_LAB.friction:g}: use the argument of bikeFE
    Ff = {_LAB.friction}
""")

_BACKWARDS = {
    'psi': 'psi grows the wrong way for a left turn (d_f > 0): is its sign right?',
    'v': 'v falls when it must grow: is the sign of ts * (a + F_ext / m) right?',
}


def _of_integration(name: str) -> tuple[Mistake, ...]:
    """Return the mistakes that each of the four equations can have."""
    return _read(f"""
{name} does not change: is {name}_next computed, and returned?
    {name}_next = {name}
{name}_next is always 0: is it computed, and returned?
    {name}_next = 0
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
{_BACKWARDS.get(name, f'{name} moves backwards: is its sign right?')}
    {name}_ts = -ts
the car moves forward in {name} when it reverses: keep the sign of v
    {name}_rate = sign(v) * ({EQUATIONS[f'{name}_rate']})
""")


#: The likelier ones first.
MISTAKES = (
    *(mistake for name in NAMES for mistake in _of_integration(name)),
    *BETA,
    *COURSE,
    *TURN,
    *SPEED,
)
