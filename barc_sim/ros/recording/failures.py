"""What a recorder cannot record, or only in part: each with one warning."""

from __future__ import annotations

from typing import TYPE_CHECKING

from barc_sim.errors import escaped

if TYPE_CHECKING:
    from rclpy.impl.rcutils_logger import RcutilsLogger

    from barc_sim.bags.messages import Topic


class Failures:
    """The topics that cannot be recorded, and those without a definition."""

    def __init__(self, logger: RcutilsLogger) -> None:
        """Warn with `logger`."""
        self._logger = logger
        self.left_out: dict[str, str] = {}  #: why a topic cannot be recorded, by its name
        self._types: dict[str, list[str]] = {}  # of these topics, when they were refused
        self._undefined: set[str] = set()  # topics without a definition

    def leave_out(self, what: str, why: str) -> None:
        """Warn once that a topic, or messages of a type on it, are not recorded."""
        if what not in self.left_out:
            self.left_out[what] = why
            self._logger.warning(escaped(f'{what} is not recorded: {why}'))

    def set_types(self, name: str, types: list[str]) -> None:
        """Store the types that a topic has now, if it is left out."""
        if name in self.left_out:
            self._types[name] = types

    def is_refused(self, name: str, types: list[str]) -> bool:
        """Return whether a topic was left out while it had the same types."""
        return self._types.get(name) == types

    def check_definition(self, topic: Topic) -> None:
        """Warn once of a topic whose definition the bag does not have."""
        if topic.definition or topic.name in self._undefined:
            return
        self._undefined.add(topic.name)
        package = topic.type.partition('/')[0]
        sentence = (
            f'{topic.name} is recorded without the definition of {topic.type}, which is not '
            f'installed here: only a reader with this type can decode it; source the workspace of '
            f'{package}'
        )
        self._logger.warning(sentence)
