# SPDX-License-Identifier: Apache-2.0
"""What happens when a daemon, a token, a version or a process is not as it should be."""

import http.server
import os
import signal
import subprocess
import sys
import threading

import pytest

import splatd
from splatd import launch


def ended(pid):
    """Waits until a process that is no child of this one is gone."""
    handle = os.pidfd_open(pid)
    try:
        import select

        poll = select.poll()
        poll.register(handle, select.POLLIN)
        assert poll.poll(20000), f"process {pid} still runs"
    finally:
        os.close(handle)


@pytest.fixture
def other_server():
    """A server that is no splatd; its answer is what the test says."""

    class Handler(http.server.BaseHTTPRequestHandler):
        body = b"<html>"
        type = "text/html"

        def do_GET(self):
            self.send_response(200)
            self.send_header("Content-Type", self.type)
            self.send_header("Content-Length", str(len(self.body)))
            self.end_headers()
            self.wfile.write(self.body)

        def log_message(self, *arguments):
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield Handler, f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    server.server_close()


def test_a_daemon_that_dies(demo):
    daemon = splatd.start(backend="cpu")
    volume = daemon.load("demo:engine?size=32")
    session = volume.view(size=(32, 32)).share()
    stream = session.stream()
    stream.wait()
    os.kill(daemon.process.pid, signal.SIGKILL)
    with pytest.raises(splatd.errors.ConnectionFailed):
        while True:
            stream.wait(1)
    with pytest.raises(splatd.errors.ConnectionFailed):
        next(stream)
    with pytest.raises(splatd.errors.ConnectionFailed, match="Is splatd running"):
        volume.refresh()
    stream.close()
    daemon.close()


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_the_daemon_ends_with_a_killed_parent(number):
    script = "import splatd, sys; d = splatd.start(backend='null'); print(d.process.pid, flush=True); sys.stdin.read()"
    parent = subprocess.Popen(
        [sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )
    pid = int(parent.stdout.readline())
    parent.send_signal(number)
    parent.wait()
    try:
        ended(pid)
    except ProcessLookupError:
        pass  # it ended already
    parent.stdin.close()
    parent.stdout.close()


def test_the_daemon_ends_with_a_parent_that_returns():
    script = "import splatd; d = splatd.start(backend='null'); print(d.process.pid)"
    pid = int(subprocess.check_output([sys.executable, "-c", script]))
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_python_ends_with_an_open_stream():
    script = (
        "import splatd; d = splatd.start(backend='cpu'); v = d.load('demo:engine?size=32').view(size=(8, 8))\n"
        "stream = v.share().stream(); stream.wait(); print(d.process.pid)"
    )
    pid = int(subprocess.check_output([sys.executable, "-c", script], timeout=60))
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_a_forked_process_leaves_the_daemon_alone():
    script = (
        "import os, sys, splatd; d = splatd.start(backend='null')\n"
        "child = os.fork()\n"
        "if child == 0: sys.exit(0)\n"
        "os.waitpid(child, 0); d.volumes(); print('alive' if os.path.exists(d.socket_path) else 'no socket')"
    )
    printed = subprocess.check_output([sys.executable, "-W", "ignore", "-c", script], timeout=60)
    assert printed.strip() == b"alive"


def test_forked_processes_have_their_own_connections():
    script = (
        "import os, splatd; d = splatd.start(backend='cpu'); v = d.load('demo:engine?size=32').view()\n"
        "v.render(size=(8, 8)); child = os.fork(); size = (16, 24) if child else (32, 40)\n"
        "good = all(v.render(size=size).shape[:2] == size[::-1] for _ in range(20))\n"
        "if not child: os._exit(not good)\n"
        "print(good and os.waitpid(child, 0)[1] == 0)"
    )
    printed = subprocess.check_output([sys.executable, "-W", "ignore", "-c", script], timeout=60)
    assert printed.strip() == b"True"


def test_options_have_the_home_folder(monkeypatch):
    monkeypatch.setenv("HOME", "/home/someone")
    assert launch.arguments_of({"data": "~/scans"}) == ["--data", "/home/someone/scans"]


def test_a_wrong_token(daemon):
    stranger = splatd.connect(daemon.url, token="0123456789abcdef0123456789abcdef")
    with pytest.raises(splatd.errors.Unauthorized):
        stranger.volumes()


def test_the_printed_address_has_the_token(daemon):
    again = splatd.connect(f"{daemon.url}/?token={daemon.token}")
    assert [volume.id for volume in again.volumes()] == [volume.id for volume in daemon.volumes()]


def test_environment(daemon, monkeypatch):
    monkeypatch.setenv("SPLATD_URL", daemon.url)
    monkeypatch.setenv("SPLATD_TOKEN", daemon.token)
    splatd.connect().volumes()
    monkeypatch.delenv("SPLATD_URL")
    with pytest.raises(ValueError, match="SPLATD_URL"):
        splatd.connect()


def test_wrong_addresses():
    with pytest.raises(ValueError, match="address of a daemon"):
        splatd.connect("ftp://host/")
    with pytest.raises(splatd.errors.ConnectionFailed, match="does not answer"):
        splatd.connect("http://127.0.0.1:1")
    with pytest.raises(splatd.errors.ConnectionFailed, match="nowhere"):
        splatd.connect("unix:/nowhere/socket")


def test_another_program(other_server):
    handler, url = other_server
    with pytest.raises(splatd.errors.IncompatibleVersion, match="not JSON"):
        splatd.connect(url)
    handler.body = b'{"status": "ready"}'
    with pytest.raises(splatd.errors.IncompatibleVersion, match="not a splatd"):
        splatd.connect(url)
    handler.body = b'{"version": "0.0.9"}'
    with pytest.raises(splatd.errors.IncompatibleVersion, match="too old"):
        splatd.connect(url)
    handler.body = b'{"version": "7.1.0-rc1"}'
    assert splatd.connect(url).version == "7.1.0-rc1"


def test_options_that_the_daemon_refuses():
    with pytest.raises(splatd.errors.StartFailed, match="--threads"):
        splatd.start(threads="many")


def test_no_program(monkeypatch, tmp_path):
    monkeypatch.setenv("SPLATD_BIN", str(tmp_path / "none"))
    with pytest.raises(splatd.errors.StartFailed, match="is not a program"):
        splatd.start()
    monkeypatch.delenv("SPLATD_BIN")
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(launch, "find_spec", lambda name: None)
    with pytest.raises(splatd.errors.StartFailed, match="pip install splatd-server"):
        splatd.start()


def test_errors_can_be_sent_between_processes():
    import pickle

    error = splatd.errors.NotFound("no volume", 404, "/volume")
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), again.code, again.pointer, str(again)) == (splatd.errors.NotFound, 404, "/volume", str(error))
