"""Writes the bag of a run without ROS."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.bags.recording import BAG_DIR, check_space, losses_as_metadata, new_directory
from barc_sim.bags.writer import BagWriter, FileLimits
from barc_sim.bags.writer_thread import WriterThread

if TYPE_CHECKING:
    from collections.abc import Mapping

    from barc_sim.bags.recording import Recording
    from barc_sim.runs.local.host import LocalHost


class LocalRecorder:
    """Records the wanted topics of a run, through the same thread as the node `bag_recorder`.

    Attributes
    ----------
    path
        The bag's directory.
    failure
        The first failure to write, in a sentence.
    left_out
        No topic: all can be recorded.

    Examples
    --------
    >>> from pathlib import Path
    >>> from barc_sim.bags.recording import Recording
    >>> from barc_sim.runs.local.host import LocalHost
    >>> host, folder = LocalHost(['--log-level', 'warn']), Path('recorded')
    >>> recorder = LocalRecorder(host, folder, Recording(), metadata={}, attachments={})
    >>> publisher = host.topics.publisher('relay', 'ecu', 'barc_interfaces/msg/ECU')
    >>> publisher.publish(1_020_000_000, {'motor': 2.0, 'servo': 0.0})
    >>> recorder.close()
    >>> recorder.counts['/ecu']
    1
    """

    def __init__(
        self,
        host: LocalHost,
        directory: Path,
        recording: Recording,
        *,
        metadata: Mapping[str, str],
        attachments: Mapping[str, bytes],
    ) -> None:
        """Make the bag in the folder `directory`.

        Raises
        ------
        UserError
            The bag cannot be made.
        """
        self._node = host.node('bag_recorder')
        self._topics = host.topics
        # Its first parameters are not recorded, nor are they with ROS.
        self._topics.record(recording)
        table = [BAG_DIR._replace(default=str(directory))]
        directory = Path(self._node.declare(table, {})[BAG_DIR.name])
        self._recording = recording
        self.failure: str | None = None
        self._stops_run = False
        self.left_out: Mapping[str, str] = {}
        check_space(directory, recording.reserve)
        self.path = new_directory(directory)
        limits = FileLimits(recording.max_bag_size, recording.max_bag_duration)
        self._writer = BagWriter(self.path, metadata=metadata, limits=limits)
        self._thread = WriterThread(
            self._writer, self._topics.take, recording.reserve, self._on_failure
        )
        self._thread.attach(attachments)
        self._thread.start()
        self._node.info(f'recording to {str(self.path)!r}')

    def _on_failure(self, failure: str | None) -> None:
        if failure is None:
            self._node.warning(f'recording to {str(self.path)!r} continues')
            return
        self.failure = self.failure or failure
        self._node.error(failure)
        self._stops_run = self._recording.on_write_error == 'stop'

    def keep_up(self) -> bool:
        """Write here if the thread cannot keep up; return whether a failure is to end the run."""
        if self._topics.waiting > self._recording.depth:
            self._thread.write_now()
        return self._stops_run

    def use_simulated_time(self) -> None:
        """Stamp messages with `/clock`, once there is one."""
        self._thread.use_sim_time = True

    @property
    def counts(self) -> dict[str, int]:
        """Number of messages in the bag's files, by topic."""
        return self._writer.on_disk

    @property
    def lost(self) -> dict[str, dict[str, int] | None]:
        """Number of messages lost, by topic: only what the disk has refused to the end."""
        unwritten = self._thread.unwritten
        return {
            topic: {self._node.name: unwritten[topic]} if topic in unwritten else {}
            for topic in self._writer.counts
        }

    def add_metadata(self, entries: Mapping[str, str]) -> None:
        """Add metadata of the run to the bag."""
        self._thread.add_metadata(entries)

    def close(self) -> None:
        """Write the waiting messages and finish the bag."""
        self._thread.close(lambda: losses_as_metadata(self.lost, {}))
