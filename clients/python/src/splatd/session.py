# SPDX-License-Identifier: Apache-2.0
"""Sessions: one view that several people look at, its links, measurements and streams."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from . import errors
from ._http import segment
from .image import Image
from .stream import Stream
from .transfer import Color, color_of
from .view import View

if TYPE_CHECKING:
    from .daemon import Daemon


class Measures(Mapping[str, Mapping[str, Any]]):
    """The measurements of a session by their ids (schema SessionMeasurement)."""

    def __init__(self, session: Session) -> None:
        self._session = session

    def _all(self) -> dict[str, dict[str, Any]]:
        answer = self._session.daemon.http.json("GET", f"{self._session._path}/measures")
        return {measure["id"]: measure for measure in answer["measures"]}

    def __getitem__(self, id: str) -> dict[str, Any]:
        return self._all()[id]

    def __iter__(self) -> Iterator[str]:
        return iter(self._all())

    def __len__(self) -> int:
        return len(self._all())

    def add(self, kind: str, points: Sequence[Sequence[float]], **members: Any) -> dict[str, Any]:
        """Adds a measurement for all participants. `members`: text, color, hidden, range."""
        request = {"kind": kind, "points": [[float(part) for part in point] for point in points], **members}
        return self._session.daemon.http.json("POST", f"{self._session._path}/measures", json=request)

    def change(self, id: str, **members: Any) -> dict[str, Any]:
        """Changes members of a measurement."""
        return self._session.daemon.http.json("PATCH", f"{self._session._path}/measures/{segment(id)}", json=members)

    def remove(self, id: str) -> None:
        """Removes a measurement."""
        self._session.daemon.http.request("DELETE", f"{self._session._path}/measures/{segment(id)}")

    def csv(self) -> str:
        """All measurements as a table for a spreadsheet."""
        answer = self._session.daemon.http.request("GET", f"{self._session._path}/measures", query={"format": "csv"})
        return answer.data.decode()


class Session:
    """One view that several people look at. Make one with `View.share`; in a `with` statement it is deleted at its
    end."""

    def __init__(self, daemon: Daemon, state: Mapping[str, Any]) -> None:
        self.daemon = daemon
        self._state = dict(state)

    @property
    def id(self) -> str:
        """The id in the daemon."""
        return self._state["id"]

    @property
    def _path(self) -> str:
        return f"api/v1/sessions/{segment(self.id)}"

    def __repr__(self) -> str:
        return f"<splatd.Session {self.id}>"

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *exception: object) -> None:
        try:
            self.delete()
        except (errors.NotFound, errors.ConnectionFailed):
            pass

    @property
    def tokens(self) -> dict[str, str]:
        """The join tokens by role, "view" and "control". Empty if another token created the session."""
        return dict(self._state.get("tokens") or {})

    def link(self, role: str = "view") -> str:
        """The address of the page for others.

        Parameters
        ----------
        role : str
            "view": to watch. "control": to change the view as well.
        """
        tokens = self._state.get("tokens")
        if not tokens:
            raise errors.Unauthorized("only the token that created the session receives its links", 403)
        if role not in tokens:
            raise ValueError(f"role: {role!r} is not view or control")
        if not self.daemon.url.startswith("http"):
            raise errors.Error(
                "the daemon has only a Unix socket, which browsers cannot open: start it with --listen ADDRESS:PORT too"
            )
        return f"{self.daemon.url}/#session={self.id}&token={tokens[role]}"

    def open(self) -> None:
        """Opens the page in a browser of this computer, with control of the view."""
        import webbrowser

        webbrowser.open(self.link("control"))

    def refresh(self) -> Session:
        """Reads view and participants again, and returns the session itself."""
        self._state = {**self._state, **self.daemon.http.json("GET", self._path)}
        return self

    @property
    def document(self) -> dict[str, Any]:
        """The view of all participants with every member, asked for now."""
        return dict(self.refresh()._state["view"])

    @property
    def view(self) -> View:
        """The view of all participants, asked for now."""
        document = self.document
        return View(self.daemon.volume(document.pop("volume")), document)

    @property
    def participants(self) -> list[dict[str, Any]]:
        """Who looks at it now: id, role, name, color."""
        return list(self.refresh()._state.get("participants", []))

    def change(self, **patch: Any) -> dict[str, Any]:
        """Changes the view for all participants, and returns all of it.

        Examples
        --------
        >>> with demo.view().share() as session:
        ...     round(session.change(camera={"fov_y": 20})["camera"]["fov_y"])
        20
        """
        answer = self.daemon.http.json("PATCH", self._path, json={"view": patch})
        self._state["view"] = answer["view"]
        return dict(answer["view"])

    def show(self, view: View) -> dict[str, Any]:
        """Gives all participants another view."""
        return self.change(**view.document)

    def snapshot(
        self,
        *,
        size: tuple[int, int] | None = None,
        format: str = "png",
        quality: int | None = None,
        background: Color | None = None,
    ) -> Image:
        """An image of the present view, in any size."""
        query: dict[str, Any] = {"format": format, "quality": quality}
        if size is not None:
            query["size"] = f"{size[0]},{size[1]}"
        if background is not None:
            query["background"] = json.dumps([*color_of(background), 1])
        answer = self.daemon.http.request("GET", f"{self._path}/snapshot", query=query)
        return Image.of_answer(answer.data, answer.headers)

    @property
    def measures(self) -> Measures:
        """The measurements of all participants, like a dict by id."""
        return Measures(self)

    def fork(self) -> Session:
        """A session of its own that begins with this view."""
        return Session(self.daemon, self.daemon.http.json("POST", "api/v1/sessions", json={"from": self.id}))

    def stream(self, **settings: Any) -> Stream:
        """Joins the session and receives its frames: see `splatd.Stream`."""
        return Stream(self.daemon.http, self.id, owner=self.daemon, **settings)

    def delete(self) -> None:
        """Ends the session for all participants."""
        self.daemon.http.request("DELETE", self._path)
