# SPDX-License-Identifier: Apache-2.0
"""Runs splatctl, and a fake daemon that gives it the answers of a test."""
import http.server
import json
import os
import subprocess
import sys
import tempfile
import threading
import unittest

SPLATCTL = sys.argv.pop(1)


def run(*arguments, stdin=b'', env=None):
    environment = {k: v for k, v in os.environ.items() if not k.startswith('SPLATD_') and 'proxy' not in k.lower()}
    environment.update(env or {})
    return subprocess.run([SPLATCTL, *arguments], input=stdin, capture_output=True, env=environment, timeout=120,
                          check=False)


class Daemon(http.server.BaseHTTPRequestHandler):
    """A fake daemon. `answers` maps (method, path) to a list of answers, the last of which is repeated. Content that is a
    list is sent piece by piece; a callable piece is called instead of sent."""
    answers, seen, change = {}, [], threading.Condition()

    def do_any(self):
        length = int(self.headers.get('Content-Length', 0))
        body = self.rfile.read(length)
        Daemon.seen.append((self.command, self.path, self.headers, body))
        with Daemon.change:
            Daemon.change.notify_all()
        queue = Daemon.answers.get((self.command, self.path.split('?')[0]))
        if not queue:
            queue = [problem(404, 'there is nothing')]
        status, kind, content, headers = queue.pop(0) if len(queue) > 1 else queue[0]
        if status is None:
            return  # the connection ends without an answer
        self.send_response(status)
        self.send_header('Content-Type', kind)
        pieces = content if isinstance(content, list) else [content]
        self.send_header('Content-Length', str(sum(len(p) for p in pieces if not callable(p)) + headers.get('cut', 0)))
        for name, value in ((n, v) for n, v in headers.items() if n != 'cut'):
            self.send_header(name, value)
        self.end_headers()
        for piece in pieces:
            if callable(piece):
                piece()
            else:
                self.wfile.write(piece)

    do_GET = do_POST = do_DELETE = do_HEAD = do_any

    def log_message(self, *_):
        pass


def answer(status, value):
    return status, 'application/json', json.dumps(value).encode(), {}


def problem(status, detail, pointer=None):
    body = {'type': 'about:blank', 'title': 'No', 'status': status, 'detail': detail}
    if pointer:
        body['pointer'] = pointer
    return status, 'application/problem+json', json.dumps(body).encode(), {}


def volume(state, **more):
    return {'id': 'head 1', 'name': 'head', 'source': 'head.nrrd', 'state': state, 'progress': 0.5, **more}


def path(state, done, frames):
    more = {'reason': f'frame {done}: no memory'} if state == 'failed' else {}
    return {'id': 'p1', 'state': state, 'format': 'png', 'frames': frames, 'done': done, **more}


PIXELS = b'\x89PNG\r\n\x1a\n' + b'content' * 100000


class RemoteCase(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.server = http.server.ThreadingHTTPServer(('127.0.0.1', 0), Daemon)
        threading.Thread(target=cls.server.serve_forever, daemon=True).start()
        cls.url = f'http://127.0.0.1:{cls.server.server_port}'

    @classmethod
    def tearDownClass(cls):
        cls.server.shutdown()
        cls.server.server_close()

    def setUp(self):
        Daemon.answers, Daemon.seen = {}, []
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.out = os.path.join(self.folder.name, 'a.png')

    def run_at(self, *arguments, stdin=b'', url='/?token=se%63ret'):
        return run('--url', self.url + url, *arguments, stdin=stdin)

    def deleted(self):
        return [s[1] for s in Daemon.seen if s[0] == 'DELETE']
