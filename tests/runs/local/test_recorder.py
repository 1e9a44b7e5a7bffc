"""The recorder of a run without ROS."""

from pathlib import Path

import pytest

from barc_sim.bags.recording import Recording
from barc_sim.bags.writer_thread import WriterThread
from barc_sim.runs.local.host import LocalHost
from barc_sim.runs.local.recorder import LocalRecorder


def test_messages_do_not_pile_up_where_the_thread_cannot_keep_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(WriterThread, 'start', lambda _: None)
    host = LocalHost([])
    recorder = LocalRecorder(host, tmp_path, Recording(), metadata={}, attachments={})
    publisher = host.topics.publisher('controller', 'ecu', 'barc_interfaces/msg/ECU')
    most = 0
    for number in range(50_000):
        publisher.publish(0, {'motor': float(number), 'servo': 0.0})
        assert not recorder.keep_up()
        most = max(most, host.topics.waiting)
    recorder.close()
    assert most < 20_000
    assert recorder.counts['/ecu'] == 50_000
