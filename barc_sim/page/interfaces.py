"""What the live page needs of others: its content, its clients, and what it offers at the end."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from barc_sim.page.protocol import File, Request

    #: Called with whether the request succeeded, and if not, with the reason.
    OnDone = Callable[[bool, str], None]


class OpenPage(Protocol):
    """A page that is open in a browser."""

    def send(self, message: str | bytes) -> None:
        """Send a message without waiting."""


class Host(Protocol):
    """The source of a page's content; the server's thread calls all of it."""

    def greet(self) -> Iterable[str | bytes]:
        """Return the messages for a new page."""

    def receive(self, page: OpenPage, request: Request) -> None:
        """Handle a request of a page."""

    def leave(self, page: OpenPage) -> None:
        """Handle that a page has closed."""

    def pulse(self) -> float:
        """Do the periodic work; return the time to the next call [s]."""

    def file(self, name: str) -> File | None:
        """Return a file to download; called in a thread of its own."""


class Clients(Protocol):
    """Passes a page's requests to the simulator and the controller, without waiting.

    What is passed back is called in the server's thread.
    """

    def reset(self, on_done: OnDone) -> None:
        """Reset the car to the start."""

    def reset_controller(self, on_done: OnDone) -> None:
        """Reset the controller alone."""

    def pause(self, on: bool, on_done: OnDone) -> None:
        """Pause or resume simulated time."""

    def tune(self, node: str, name: str, value: float, on_done: OnDone) -> None:
        """Set a parameter of a node."""

    def parameters(
        self, node: str, names: Sequence[str], on_values: Callable[[dict[str, Any]], None]
    ) -> bool:
        """Request parameters of a node; False if it is not there."""


class Offer(Protocol):
    """What a page can do after the end of its run."""

    def message(self) -> str:
        """Return the message that shows a page what is offered."""

    def file(self, name: str) -> File | None:
        """Return a file to download."""

    def compare(self) -> Iterable[str | bytes]:
        """Return the messages that show the run before."""

    def again(self, values: Mapping[str, float]) -> str:
        """Drive again with these values of the sliders; return the next page's address."""
