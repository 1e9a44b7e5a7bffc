"""The parameters of the node `vehicle_simulator`; `plant_values` makes a plant of them."""

from __future__ import annotations

from barc_sim.vehicle.bike_model import Vehicle
from barc_sim.vehicle.parameter import Parameter
from barc_sim.vehicle.tyres import Handling

_VEHICLE = Vehicle()
_HANDLING = Handling()
_ACTUATORS = [
    Parameter(f'{name}_{part}', 0.0, f'{what}; 0: none', (0.0, greatest))
    for name, unit, limit in (('motor', 'm/s²', 'acceleration'), ('servo', 'rad', 'steering'))
    for part, what, greatest in (
        ('delay', f'time from a command to its effect on the {name} [s]', 10.0),
        ('lag', f'time constant of the {name} [s]', 100.0),
        ('rate_limit', f'greatest change of {limit} [{unit}/s]', 1e6),
        ('limit', f'greatest {limit} either way [{unit}]', 1e6),
    )
]
PARAMETERS = [
    Parameter('mass', _VEHICLE.mass, 'm, the mass [kg]', (1.0, 1e6)),
    Parameter('air_drag_coeff', _VEHICLE.air_drag_coeff, 'a_0, air drag [N s²/m²]', (0.0, 1e3)),
    Parameter('friction', _VEHICLE.friction, 'F_f, rolling resistance [N]', (0.0, 1e6)),
    Parameter('l_f', _VEHICLE.l_f, 'centre of mass to front axle [m]', (0.01, 100.0)),
    Parameter('l_r', _VEHICLE.l_r, 'centre of mass to rear axle [m]', (0.01, 100.0)),
    Parameter('gravity', _VEHICLE.gravity, 'g [m/s²]', (0.0, 100.0)),
    Parameter('rate', 50.0, 'steps per second of simulated time [Hz]', (1.0, 1000.0)),
    Parameter('road', 'lab', "'lab', 'flat' or a CSV file with the columns start_m,grade_deg"),
    Parameter(
        'realtime_factor',
        1.0,
        'simulated seconds per second; 0: each step as soon as its command has arrived',
        (0.0, 1000.0),
    ),
    Parameter(
        'clock',
        default=False,
        description='whether /clock tells the simulated time where realtime_factor is 1, too',
    ),
    Parameter('wait_for_controller', True, 'whether time begins only when somebody publishes ecu'),
    Parameter(
        'command_timeout',
        0.0,
        'where no command has arrived for so long [s, by the wall clock], the car brakes to a '
        'standstill, and commands are not due state by state until one bears a stamp; 0: never',
        (0.0, 3600.0),
    ),
    Parameter('timeout_braking', 8.0, 'deceleration where commands are lost [m/s²]', (0.0, 100.0)),
    Parameter('refuse_motor_above', 100.0, 'a command beyond is refused [m/s²]', (0.0, 1e6)),
    Parameter('refuse_servo_above', 1.5, 'a command beyond is refused [rad]', (0.0, 1.5)),
    Parameter('seed', 0, 'seed of the measurement noise', (0, 2**53)),
    Parameter('noise_s', 0.0, 'standard deviation of position along [m]', (0.0, 1e3)),
    Parameter('noise_ey', 0.0, 'standard deviation of position across [m]', (0.0, 1e3)),
    Parameter('noise_epsi', 0.0, 'standard deviation of heading [rad]', (0.0, 1e3)),
    Parameter('noise_v_x', 0.0, 'standard deviation of v_x [m/s]', (0.0, 1e3)),
    Parameter('noise_v_y', 0.0, 'standard deviation of v_y [m/s]', (0.0, 1e3)),
    Parameter('noise_psi_dot', 0.0, 'standard deviation of yaw rate [rad/s]', (0.0, 1e3)),
    *_ACTUATORS,
    Parameter('integrator', 'euler', "'euler' (forward) or 'rk4' (Runge-Kutta)"),
    Parameter('dynamics', 'kinematic', "'kinematic' or 'dynamic': the bicycle with linear tyres"),
    Parameter('yaw_inertia', _HANDLING.yaw_inertia, 'I_z of the dynamic one [kg m²]', (1.0, 1e7)),
    Parameter(
        'front_stiffness', _HANDLING.front_stiffness, "C_f, front axle's tyres [N/rad]", (1.0, 1e8)
    ),
    Parameter(
        'rear_stiffness', _HANDLING.rear_stiffness, "C_r, rear axle's tyres [N/rad]", (1.0, 1e8)
    ),
    Parameter(
        'dynamic_above',
        _HANDLING.dynamic_above,
        'slower than this [m/s], and in reverse, the dynamic bicycle is the kinematic one',
        (0.1, 100.0),
    ),
]
