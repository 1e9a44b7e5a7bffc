"""The nodes of a run for ROS's own tools: `mirror`, and the server of the Foxglove app."""

from __future__ import annotations

from typing import TYPE_CHECKING

from barc_sim.nodes.mirrors.diagnosis import Facts
from barc_sim.nodes.mirrors.kinds import MIRRORS
from barc_sim.runs.view_options import wanted_mirrors
from barc_sim.vehicle.sensor import NoiseLevels

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Iterator, Sequence

    from rclpy.node import Node

    from barc_sim.nodes.recorder import BagRecorder
    from barc_sim.nodes.simulator import VehicleSimulator


def mirrors(
    options: Namespace, simulators: Sequence[VehicleSimulator], recorder: BagRecorder | None
) -> Iterator[Node]:
    """Yield the nodes that the options ask for; only those are imported.

    Each car has a `mirror` in its simulator's namespace.

    Raises
    ------
    UserError
        if the Foxglove SDK is not installed, or the port is taken.
    """
    names = wanted_mirrors(options)
    if names:
        for simulator in simulators:
            yield _mirror(names, simulator, recorder)
    port = getattr(options, 'foxglove', None)
    if port is not None:
        from barc_sim.nodes.foxglove.node import FoxgloveServer  # noqa: PLC0415

        server = FoxgloveServer(port)
        if not options.quiet:
            print(f'foxglove   {server.url}', flush=True)  # noqa: T201
        yield server


def _mirror(
    names: frozenset[str], simulator: VehicleSimulator, recorder: BagRecorder | None
) -> Node:
    from rclpy.parameter import Parameter  # noqa: PLC0415

    from barc_sim.nodes.mirrors.node import MirrorNode  # noqa: PLC0415

    shared = ('road', 'l_f', 'l_r', 'realtime_factor')
    values = {name: simulator.get_parameter(name).value for name in shared}
    factor = values.pop('realtime_factor')
    noise = NoiseLevels(
        *(simulator.get_parameter(f'noise_{name}').value for name in NoiseLevels._fields)
    )

    def facts() -> Facts:
        stepper = simulator.stepper
        known = Facts(stepper.missed, stepper.slipped, stepper.paused, factor, noise)
        if factor == 1.0:
            known = known._replace(stamp_lag=stepper.stamp_lag)
        if not recorder:
            return known
        return known._replace(
            recorded=sum(recorder.counts.values()),
            lost=sum(sum(by_node.values()) for by_node in recorder.lost.values() if by_node),
            failure=recorder.failure,
        )

    values |= {name: name in names for name in MIRRORS}
    return MirrorNode(
        road=simulator.road,
        facts=facts,
        namespace=simulator.get_namespace(),
        parameter_overrides=[Parameter(name, value=value) for name, value in values.items()],
    )
