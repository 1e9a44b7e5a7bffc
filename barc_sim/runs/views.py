"""Adds mirrors and live pages to a run: nodes that show what its simulators publish."""

from __future__ import annotations

from typing import TYPE_CHECKING

from barc_sim.nodes.controller import CruiseController
from barc_sim.runs.options import page_of
from barc_sim.runs.report import print_line

if TYPE_CHECKING:
    from barc_sim.control.cruise_control import CruiseControl
    from barc_sim.nodes.mirror import RunDiagnostics
    from barc_sim.nodes.recorder import BagRecorder
    from barc_sim.nodes.simulator import VehicleSimulator
    from barc_sim.runs.composition import Run

#: Options of a run that the command on the page repeats.
_COPIED = ('lab', 'model', 'controller', 'lane', 'policy', 'dynamics')


def add_views(run: Run) -> None:
    """Add the mirrors and the live pages that the options ask for, one for each car."""
    if run.options.mirrors:
        for simulator in run.simulators:
            _add_mirror(run, simulator)
    if page_of(run.options) != 'none':
        for number, simulator in enumerate(run.simulators):
            _add_page(run, simulator, number)


def _add_mirror(run: Run, simulator: VehicleSimulator) -> None:
    from barc_sim.nodes.mirror import MirrorNode  # noqa: PLC0415 (only if wanted)

    recorder = run.bag.recorder if run.bag else None
    run.add(
        MirrorNode,
        {'road': simulator.values['road']},
        namespace=simulator.get_namespace(),
        reads=simulator,
        road=simulator.road,
        track=simulator.track,
        facts=lambda: _facts(simulator, recorder),
    )


def _facts(simulator: VehicleSimulator, recorder: BagRecorder | None) -> RunDiagnostics:
    """Return the facts about a simulator and the bag that no topic carries."""
    from barc_sim.nodes.mirror import RunDiagnostics  # noqa: PLC0415 (only if wanted)

    stepper = simulator.stepper
    facts = RunDiagnostics(missed=stepper.missed, slipped=stepper.slipped)
    if simulator.values['realtime_factor'] == 1.0:
        facts = facts._replace(stamp_lag=stepper.stamp_lag)
    if recorder:
        facts = facts._replace(
            recorded=sum(recorder.counts.values()),
            lost=recorder.missing.total,
            failure=recorder.failure,
        )
    return facts


def _add_page(run: Run, simulator: VehicleSimulator, number: int) -> None:
    """Serve the live page of a car."""
    from barc_sim.nodes.view import ViewNode  # noqa: PLC0415 (a server, only if wanted)
    from barc_sim.page.protocol import RunFacts, Status  # noqa: PLC0415

    options = run.options
    stepper = simulator.stepper
    copied = {name: getattr(options, name, None) for name in _COPIED}
    facts = RunFacts(
        simulator=lambda: simulator.values,
        control=_control(run, simulator.get_namespace()),
        road=simulator.road,
        track=simulator.track,
        status=lambda: Status(missed=stepper.missed, paused=stepper.paused),
        finish=run.finish,
        options={name: str(value) for name, value in copied.items() if value},
    )

    port = options.view_port + number if options.view_port else 0  # 0: any free port
    view = run.add(
        ViewNode,
        namespace=simulator.get_namespace(),
        reads=simulator,
        mode=options.mode,
        host=options.view_host,
        port=port,
        run=facts,
    )
    run.pages.append(view.page)
    print_line(options, f'live page  {view.url}')
    if page_of(options) == 'web':
        view.page.open_browser()


def _control(run: Run, namespace: str) -> CruiseControl | None:
    """Return what the controller of a namespace computes with; None: it has no controller."""
    for node in run.nodes:
        if isinstance(node, CruiseController) and node.get_namespace() == namespace:
            return node.control
    return None
