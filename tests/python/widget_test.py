# SPDX-License-Identifier: Apache-2.0
"""The widget on the side of the kernel: a fake page sends the messages of clients/web/widget/kernel.js."""

import gc
import queue
import threading

import pytest

import splatd
from splatd import _channel, notebook

pytest.importorskip("anywidget", reason="no anywidget: pip install 'splatd[jupyter]'")
from splatd import widget as module
from splatd.stream import decode_frame

DEADLINE = 60.0
CHANGES = 60  # of a view
UNSEEN_MAX = 20  # frames without acknowledgements


class Page:
    """What a notebook's page does with one view of a widget."""

    def __init__(self, widget, name="page"):
        self.widget = widget
        self.name = name
        self.heard = queue.Queue()

    def tell(self, type, **content):
        self.widget._handle_custom_msg({**content, "type": type, "of": self.name}, [])

    def wait(self, type):
        """The next message of this type and its buffers; others before it are dropped."""
        while True:
            content, buffers = self.heard.get(timeout=DEADLINE)
            if content["type"] == type:
                return content, buffers

    def take(self):
        """All messages that are there."""
        taken = []
        while not self.heard.empty():
            taken.append(self.heard.get())
        return taken

    def frame(self, acknowledges=True):
        _, (data,) = self.wait("frame")
        frame = decode_frame(data)
        if acknowledges:
            self.call("stream.ack", frame=frame.number)
        return frame

    def call(self, method, **params):
        text = splatd.stream.json.dumps({"jsonrpc": "2.0", "method": method, "params": params})
        self.tell("send", id=1, text=text)

    def rest(self):
        """The next frame of final quality."""
        while True:
            frame = self.frame()
            if frame.is_final:
                return frame


@pytest.fixture
def script(tmp_path, monkeypatch):
    """A script in place of the bundle, which the build of the repository makes."""
    path = tmp_path / "widget.js"
    path.write_text("export default {}")
    monkeypatch.setattr(module, "SCRIPT", path)


@pytest.fixture
def make(demo, script):
    """Makes widgets with a page; they are closed at the end."""
    made = []

    def make_one(**options):
        widget = demo.view(size=(64, 48)).show(**options)
        page = Page(widget)
        widget.send = lambda content, buffers=None: page.heard.put((content, buffers))
        made.append(widget)
        return widget, page

    yield make_one
    for widget in made:
        widget.close()


def threads():
    return [thread for thread in threading.enumerate() if thread.name.startswith("splatd-widget-")]


def sessions(demo):
    return [session["id"] for session in demo.daemon.sessions()]


def join(page):
    page.tell("hello")
    welcome, _ = page.wait("welcome")
    page.tell("open", id=1)
    page.wait("opened")
    return welcome


def test_welcome_names_the_session_and_its_join_token_alone(make, demo):
    widget, page = make(transport="auto")
    welcome = join(page)
    assert welcome["session"] == widget.session.id
    assert welcome["url"] == f"{demo.daemon.url}/" and welcome["url"].endswith(f":{welcome['port']}/")
    assert welcome["transport"] == "auto"
    assert demo.daemon.token not in repr(welcome) + repr(widget.get_state())
    assert welcome["token"] not in repr(widget.get_state()), "notebooks keep the state"


def test_frames_pass_through_as_they_are_and_wait_for_the_page(make):
    widget, page = make()
    join(page)
    first = page.rest()
    assert first.image.shape == (48, 64, 4)
    # The daemon stops when an acknowledgement is late, which it knows within 0.1 s (server/session/congestion.h).
    for number in range(1, CHANGES + 1):
        page.call("view.update", seq=number, patch={"camera": {"azimuth": number}})
        widget.snapshot(size=(64, 48))
    unseen = [decode_frame(buffers[0]) for content, buffers in page.take() if content["type"] == "frame"]
    assert 1 <= len(unseen) < UNSEEN_MAX
    page.call("stream.ack", frame=unseen[-1].number)
    while page.rest().seq < CHANGES:
        pass


def test_requests_of_the_session_pass_and_others_do_not(make, demo):
    widget, page = make()
    join(page)
    path = f"api/v1/sessions/{widget.session.id}"

    def ask(method, path, body=None):
        page.tell("request", id=5, method=method, path=path, body=body)
        content, (data,) = page.wait("answer")
        assert content["id"] == 5
        return content["status"], data

    assert ask("GET", f"{path}/histogram?axis=value")[0] == 200
    assert ask("GET", f"{path}/volumes/{demo.id}/view")[0] == 200
    assert ask("POST", f"{path}/measure", '{"kind": "distance", "points": [[0,0,0],[3,4,0]]}')[0] == 200
    assert ask("GET", f"{path}/histogram?axis=other")[0] in (400, 422)
    for method, other in [
        ("DELETE", path),
        ("GET", "api/v1/sessions"),
        ("GET", f"{path}x"),
        ("GET", f"{path}/volumes/../../../volumes"),
        ("GET", f"{path}/stream"),
        ("GET", "../secret"),
        ("PATCH", path),
    ]:
        assert ask(method, other)[0] == 403, (method, other)
    assert not _channel.is_allowed("GET", f"{path}\r\nX: y", widget.session.id)


def test_programs_see_and_change_the_view(make):
    widget, page = make()
    join(page)
    seen = []
    widget.observe(lambda change: seen.append(change["new"]["background"]), "document")
    widget.change(background=[0, 1, 0, 1])
    assert seen == [[0, 1, 0, 1]]
    assert list(widget.snapshot(size=(64, 48))[0, 0]) == [0, 255, 0, 255]
    assert widget.view.document["background"] == [0, 1, 0, 1]
    page.tell("view", view={**widget.document, "background": [0, 0, 1, 1]})
    assert seen[-1] == [0, 0, 1, 1]
    page.tell("used", transport="kernel: as asked")
    assert widget.transport_used == "kernel: as asked"


def test_the_last_view_that_closes_ends_session_and_threads(make, demo):
    widget, page = make()
    other = Page(widget, "other")
    join(page)
    other.tell("hello")
    page.wait("welcome")  # both pages hear all messages
    id = widget.session.id
    assert id in sessions(demo) and threads()
    widget.change(background=[0, 1, 0, 1])
    page.tell("bye")
    assert id in sessions(demo), "the other output still shows it"
    other.tell("bye")
    assert id not in sessions(demo)
    for thread in threads():
        thread.join(DEADLINE)
    assert not threads()
    assert widget.view.document["background"] == [0, 1, 0, 1]
    assert join(page)["session"] != id
    assert widget.view.document["background"] == [0, 1, 0, 1], "another display begins with the last view"


def test_close_twice_and_without_a_page(make, demo):
    widget, page = make()
    join(page)
    widget.close()
    widget.close()
    for thread in threads():
        thread.join(DEADLINE)
    assert not threads() and not sessions(demo)
    unseen, _ = make()
    assert sessions(demo)
    unseen.close()
    assert not sessions(demo)


def test_a_session_that_someone_deleted_begins_again(make):
    widget, page = make()
    join(page)
    widget.session.delete()
    closed, _ = page.wait("closed")
    assert closed["code"] == 1000
    assert join(page)["session"] == widget.session.id
    page.rest()


def test_a_stream_of_a_page_that_is_gone_ends(make, monkeypatch):
    monkeypatch.setattr(_channel, "IDLE_SECONDS", -1.0)
    monkeypatch.setattr(_channel, "LOOK_SECONDS", 0.01)
    _, page = make()
    join(page)
    closed, _ = page.wait("closed")
    assert closed["reason"] == "the page is gone"


def test_arguments_and_a_missing_bundle(demo, script, monkeypatch, tmp_path):
    with pytest.raises(ValueError, match="is not auto, websocket or kernel"):
        demo.show(transport="pigeon")
    monkeypatch.setattr(module, "SCRIPT", tmp_path / "none.js")
    with pytest.raises(ImportError, match="splatd_widget"):
        demo.show()
    gc.collect()
    assert not sessions(demo)


def test_the_origins_of_a_notebook(tmp_path, monkeypatch):
    pytest.importorskip("jupyter_core")
    monkeypatch.setenv("JUPYTER_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setenv("JPY_PARENT_PID", "17")
    assert notebook.server_origins() == []
    (tmp_path / "jpserver-17.json").write_text('{"url": "http://hub.example:8000/user/a/"}')
    assert notebook.server_origins() == ["http://hub.example:8000"]
