#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""splatctl_test.py SPLATCTL: usage, rendering in process, and the handling of answers of a daemon."""
import http.server
import json
import os
import signal
import socketserver
import struct
import subprocess
import sys
import tempfile
import threading
import time
import unittest
import zlib

SPLATCTL = sys.argv.pop(1)


def run(*arguments, stdin=b'', env=None):
    environment = {k: v for k, v in os.environ.items() if not k.startswith('SPLATD_') and 'proxy' not in k.lower()}
    environment.update(env or {})
    return subprocess.run([SPLATCTL, *arguments], input=stdin, capture_output=True, env=environment, timeout=120,
                          check=False)


def png_size(data):
    """Returns width and height. Checks the signature and the checksum of every chunk."""
    assert data[:8] == b'\x89PNG\r\n\x1a\n', data[:8]
    at, size = 8, None
    while at < len(data):
        length, kind = struct.unpack('>I4s', data[at:at + 8])
        body = data[at + 8:at + 8 + length]
        assert struct.unpack('>I', data[at + 8 + length:at + 12 + length])[0] == zlib.crc32(kind + body), kind
        if kind == b'IHDR':
            size = struct.unpack('>II', body[:8])
        at += 12 + length
    return size


class Usage(unittest.TestCase):
    def refused(self, *arguments):
        result = run(*arguments)
        self.assertEqual(result.returncode, 2, result)
        self.assertEqual(result.stdout, b'')
        text = result.stderr.decode()
        self.assertRegex(text, r'^splatctl: [^:]+: .*\n$')
        return text

    def test_help_and_version(self):
        result = run('--help')
        self.assertEqual((result.returncode, result.stderr), (0, b''))
        for word in ('volumes', 'load', 'view', 'render', '--local', '--url', 'SPLATD_URL', 'Exit status'):
            self.assertIn(word, result.stdout.decode())
        self.assertRegex(run('--version').stdout.decode(), r'^splatctl \d+\.\d+\.\d+\n$')

    def test_usage_errors(self):
        self.refused()
        self.refused('--bogus')
        self.refused('-h')
        self.assertIn('fly', self.refused('fly'))
        self.refused('load')
        self.refused('view')
        self.refused('volumes', 'a', 'b')
        self.refused('render')
        self.refused('render', '--out', 'x.png')
        self.refused('render', 'engine', '--out', 'x.png')
        self.refused('render', '--volume', 'a', '--out', 'x.gif')
        self.refused('render', '--volume', 'a', '--out', 'x.png', '--format', 'bmp')
        self.refused('render', '--volume', 'a', '--out', 'x.png', '--threads', '2')
        self.assertIn('--out', self.refused('render', '--out'))
        for size in ('5', '0,5', '5,0', '8193,1', '5x5', '5,5,5', '-1,5', ' 5,5', ',', '99999999999999999999,1'):
            self.refused('render', '--volume', 'a', '--out', 'x.png', '--size', size)
        for quality in ('0', '101', 'high', '', '50%'):
            self.refused('render', '--volume', 'a', '--out', 'x.png', '--quality', quality)


class Local(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)

    def path(self, name):
        return os.path.join(self.folder.name, name)

    def render(self, out, *arguments, stdin=b''):
        return run('render', '--local', '--out', out, *arguments, stdin=stdin)

    def test_formats_and_sizes(self):
        for name, magic in (('a.png', b'\x89PNG'), ('a.jpg', b'\xff\xd8\xff'), ('a.jpeg', b'\xff\xd8\xff'),
                            ('a.webp', b'RIFF'), ('a.exr', b'\x76\x2f\x31\x01')):
            result = self.render(self.path(name), '--volume', 'demo:phantom?size=16', '--size', '40,30')
            self.assertEqual((result.returncode, result.stdout, result.stderr), (0, b'', b''))
            with open(self.path(name), 'rb') as f:
                data = f.read()
            self.assertEqual(data[:len(magic)], magic)
            if name == 'a.png':
                self.assertEqual(png_size(data), (40, 30))
        self.assertEqual(sorted(os.listdir(self.folder.name)), ['a.exr', 'a.jpeg', 'a.jpg', 'a.png', 'a.webp'])

    def test_view_from_standard_input_to_standard_output(self):
        view = b'{"volume":"demo:phantom?size=16","size":[24,12],"shading":{"mode":"none"}}'
        result = self.render('-', '--view', '-', stdin=view)
        self.assertEqual((result.returncode, result.stderr), (0, b''))
        self.assertEqual(png_size(result.stdout), (24, 12))
        self.assertEqual(png_size(self.render('-', '--view', '-', '--size', '7,9', stdin=view).stdout), (7, 9))

    def test_same_bytes_for_any_number_of_threads(self):
        images = {self.render('-', '--volume', 'demo:engine?size=32', '--threads', str(n)).stdout for n in (1, 2, 3)}
        self.assertEqual(len(images), 1)
        self.assertEqual(png_size(images.pop()), (512, 512))

    def test_report(self):
        result = self.render(self.path('a.png'), '--volume', 'demo:phantom?size=16', '--json')
        report = json.loads(result.stdout)
        self.assertEqual(report['out'], self.path('a.png'))
        self.assertEqual(report['bytes'], os.path.getsize(self.path('a.png')))
        self.assertGreater(report['render_ms'], 0)
        self.assertGreater(report['splats'], 0)

    def refused(self, place, *arguments, stdin=b'', status=1):
        result = self.render(self.path('a.png'), *arguments, stdin=stdin)
        self.assertEqual((result.returncode, result.stdout), (status, b''), result)
        self.assertRegex(result.stderr.decode(), rf'^splatctl: {place}.*\n$')
        self.assertEqual(os.listdir(self.folder.name), [])

    def test_errors_name_their_place_and_leave_no_file(self):
        self.refused('demo:nothing', '--volume', 'demo:nothing')
        self.refused('/no/such.nrrd', '--volume', '/no/such.nrrd')
        self.refused('/camera/up: ', '--volume', 'demo:phantom?size=16', '--view', '-',
                     stdin=b'{"camera":{"up":[0,0,0]}}')
        self.refused('/camra: unknown field; did you mean "camera"', '--volume', 'demo:phantom?size=16', '--view', '-',
                     stdin=b'{"camra":{}}')
        self.refused('/primitive/type', '--volume', 'demo:phantom?size=16', '--view', '-',
                     stdin=b'{"primitive":{"type":"shell"}}')
        for text, why in ((b'{\n', 'not valid JSON at line 2'), (b'[]', 'must be a view as a JSON object'),
                          (b' ' * (2 << 20), 'is larger than')):
            self.refused(f'standard input: {why}', '--volume', 'demo:phantom?size=16', '--view', '-', stdin=text)
        self.refused('no-such-view: ', '--volume', 'demo:phantom?size=16', '--view', 'no-such-view')
        self.refused('', '--volume', 'demo:phantom?size=16', '--backend', 'abacus', status=2)

    def test_a_failed_write_keeps_the_old_file(self):
        with open(self.path('a.png'), 'wb') as f:
            f.write(b'old')
        self.assertEqual(self.render(self.path('a.png'), '--volume', 'demo:nothing').returncode, 1)
        with open(self.path('a.png'), 'rb') as f:
            self.assertEqual(f.read(), b'old')
        result = self.render(self.path('missing/a.png'), '--volume', 'demo:phantom?size=16')
        self.assertEqual(result.returncode, 1)
        self.assertIn('missing/a.png: cannot create', result.stderr.decode())
        result = self.render(self.folder.name, '--volume', 'demo:phantom?size=16')
        self.assertIn('is a folder', result.stderr.decode())
        self.assertEqual(run('render', '--local', '--volume', 'demo:phantom?size=16', '--out', '/dev/full',
                             '--format', 'png').returncode, 1)

    def test_links_and_modes_are_kept(self):
        os.symlink('target.png', self.path('link.png'))
        with open(self.path('target.png'), 'wb') as f:
            f.write(b'old')
        self.assertEqual(self.render(self.path('link.png'), '--volume', 'demo:phantom?size=16').returncode, 0)
        self.assertTrue(os.path.islink(self.path('link.png')))
        with open(self.path('target.png'), 'rb') as f:
            self.assertIsNotNone(png_size(f.read()))
        umask = os.umask(0)
        os.umask(umask)
        self.assertEqual(os.stat(self.path('target.png')).st_mode & 0o777, 0o666 & ~umask)


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

    do_GET = do_POST = do_DELETE = do_any

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


class Remote(unittest.TestCase):
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

    def test_volumes(self):
        Daemon.answers['GET', '/api/v1/volumes'] = [answer(200, {'volumes': [
            volume('ready', dims=[4, 5, 6], type='uint8', bytes=120), volume('loading')]})]
        result = self.run_at('volumes')
        self.assertEqual((result.returncode, result.stderr), (0, b''))
        self.assertIn('4x5x6', result.stdout.decode())
        self.assertEqual(len(result.stdout.splitlines()), 3)
        self.assertEqual(json.loads(self.run_at('volumes', '--json').stdout)['volumes'][1]['state'], 'loading')
        self.assertEqual(Daemon.seen[0][2]['Authorization'], 'Bearer secret')

    def test_address_and_token(self):
        Daemon.answers['GET', '/sub/path/api/v1/volumes'] = [answer(200, {'volumes': []})]
        self.assertEqual(self.run_at('volumes', url='/sub/path/?token=x').returncode, 0)
        Daemon.answers['GET', '/api/v1/volumes'] = [answer(200, {'volumes': []})]
        self.assertEqual(self.run_at('volumes', '--token', 'mine').returncode, 0)
        self.assertEqual(Daemon.seen[-1][2]['Authorization'], 'Bearer mine')
        self.assertEqual(run('volumes', env={'SPLATD_URL': self.url, 'SPLATD_TOKEN': 'env'}).returncode, 0)
        self.assertEqual(Daemon.seen[-1][2]['Authorization'], 'Bearer env')
        self.assertEqual(run('volumes', env={'SPLATD_URL': self.url}).returncode, 0)
        self.assertNotIn('Authorization', Daemon.seen[-1][2])
        result = run('volumes', env={'SPLATD_URL': self.url, 'http_proxy': 'http://127.0.0.1:1/'})
        self.assertEqual((result.returncode, result.stderr), (0, b''))
        for url in ('ftp://127.0.0.1/', 'file:///etc/passwd', 'not an address', 'http://'):
            result = run('--url', url, 'volumes')
            self.assertEqual(result.returncode, 1)
            self.assertIn('splatctl: ' + url, result.stderr.decode())
        self.assertEqual(run('--url', self.url, '--token', 'a\r\nX: y', 'volumes').returncode, 1)

    def test_no_server(self):
        result = run('--url', 'http://127.0.0.1:1/', 'volumes')
        self.assertEqual(result.returncode, 1)
        self.assertRegex(result.stderr.decode(), r'^splatctl: http://127.0.0.1:1: .*\n$')

    def test_load_waits(self):
        Daemon.answers['POST', '/api/v1/volumes'] = [answer(202, volume('loading'))]
        Daemon.answers['GET', '/api/v1/volumes/head%201'] = [answer(200, volume('loading')),
                                                              answer(200, volume('ready'))]
        result = self.run_at('load', 'head.nrrd')
        self.assertEqual((result.returncode, result.stdout, result.stderr), (0, b'head 1\n', b''))
        self.assertEqual(json.loads(Daemon.seen[0][3]), {'path': 'head.nrrd'})
        self.assertEqual([s[0] for s in Daemon.seen], ['POST', 'GET', 'GET'])
        self.assertEqual(self.run_at('load', '--no-wait', 'demo:engine').stdout, b'head 1\n')
        self.assertEqual(json.loads(Daemon.seen[-1][3]), {'uri': 'demo:engine'})

    def test_load_fails(self):
        Daemon.answers['POST', '/api/v1/volumes'] = [answer(202, volume('loading'))]
        Daemon.answers['GET', '/api/v1/volumes/head%201'] = [answer(200, volume('failed', reason='byte 7: no'))]
        result = self.run_at('load', 'head.nrrd')
        self.assertEqual((result.returncode, result.stdout), (1, b''))
        self.assertEqual(result.stderr, b'splatctl: head 1: loading failed: byte 7: no\n')
        Daemon.answers['GET', '/api/v1/volumes/head%201'] = [answer(200, volume('loading'))]
        result = self.run_at('load', 'head.nrrd', '--timeout', '1')
        self.assertIn('still loading after 1 s', result.stderr.decode())
        Daemon.answers['POST', '/api/v1/volumes'] = [problem(403, 'no data folder', '/path')]
        result = self.run_at('load', '../x.nrrd')
        self.assertEqual(result.stderr, b'splatctl: ../x.nrrd: no data folder (HTTP 403)\n')

    def test_view(self):
        Daemon.answers['GET', '/api/v1/volumes/a%2Fb/view'] = [answer(200, {'size': [1, 2]})]
        self.assertEqual(self.run_at('view', 'a/b').stdout, b'{"size":[1,2]}\n')
        result = self.run_at('view', 'none')
        self.assertEqual(result.stderr, b'splatctl: GET /volumes/none/view: there is nothing (HTTP 404)\n')

    def reply_image(self, **headers):
        Daemon.answers['GET', '/api/v1/volumes/head'] = [answer(200, {**volume('ready'), 'id': 'head'})]
        Daemon.answers['POST', '/api/v1/render'] = [(200, 'image/png', PIXELS, headers)]

    def test_render(self):
        self.reply_image(**{'X-Backend': 'cpu scalar', 'X-Render-Time': '12.5', 'X-Splats': '77'})
        result = self.run_at('render', '--volume', 'head', '--view', '-', '--out', self.out, '--size', '20,10',
                             '--quality', '70', '--json', stdin=b'{"camera":{"fov_y":40},"volume":"other"}')
        self.assertEqual((result.returncode, result.stderr), (0, b''))
        with open(self.out, 'rb') as f:
            self.assertEqual(f.read(), PIXELS)
        method, path, headers, body = Daemon.seen[-1]
        self.assertEqual((method, path), ('POST', '/api/v1/render?format=png&quality=70'))
        self.assertEqual(headers['Content-Type'], 'application/json')
        self.assertEqual(json.loads(body), {'camera': {'fov_y': 40}, 'volume': 'head', 'size': [20, 10]})
        self.assertEqual(json.loads(result.stdout), {'out': self.out, 'format': 'png', 'bytes': len(PIXELS),
                                                     'backend': 'cpu scalar', 'render_ms': 12.5, 'splats': 77})
        self.assertEqual(self.run_at('render', '--volume', 'head', '--out', '-').stdout, PIXELS)

    def test_render_loads_a_source(self):
        self.reply_image()
        Daemon.answers['POST', '/api/v1/volumes'] = [answer(202, volume('loading'))]
        Daemon.answers['GET', '/api/v1/volumes/head%201'] = [answer(200, volume('ready'))]
        self.assertEqual(self.run_at('render', '--volume', 'demo:engine', '--out', self.out).returncode, 0)
        self.assertEqual(json.loads(Daemon.seen[-1][3])['volume'], 'head 1')
        self.assertEqual(self.run_at('render', '--volume', 'new.nrrd', '--out', self.out).returncode, 0)
        self.assertEqual([s[:2] for s in Daemon.seen[-4:-2]],
                         [('GET', '/api/v1/volumes/new.nrrd'), ('POST', '/api/v1/volumes')])

    def refused(self, expected):
        result = self.run_at('render', '--volume', 'head', '--out', self.out)
        self.assertEqual((result.returncode, result.stdout), (1, b''))
        self.assertIn(expected, result.stderr.decode())
        self.assertEqual(len(result.stderr.splitlines()), 1)
        self.assertEqual(os.listdir(self.folder.name), [])

    def test_render_fails(self):
        self.reply_image()
        render = Daemon.answers['POST', '/api/v1/render']
        render[0] = problem(422, 'up is zero', '/camera/up')
        self.refused('splatctl: /camera/up: up is zero (HTTP 422)\n')
        render[0] = 500, 'text/html', b'<h1>broken</h1>', {}
        self.refused('splatctl: POST /render?format=png: HTTP status 500\n')
        render[0] = 401, 'application/problem+json', b'{"detail": not json', {}
        self.refused('HTTP status 401; pass the daemon\'s token')
        render[0] = 200, 'text/html', b'<p>a proxy speaks</p>', {}
        self.refused('the answer is text/html, not image/png')
        render[0] = 200, 'image/png', PIXELS, {'cut': 5000}
        self.refused('splatctl: http://127.0.0.1')

    def test_invalid_json(self):
        for body in (b'', b'[', b'nonsense', b'\xff\xfe'):
            Daemon.answers['GET', '/api/v1/volumes'] = [(200, 'application/json', body, {})]
            result = self.run_at('volumes')
            self.assertEqual(result.returncode, 1)
            self.assertRegex(result.stderr.decode(), r'^splatctl: GET /volumes: not valid JSON.*\n$')
        for value in ([], 7, {'volumes': 7}, {'volumes': [7, None, {'id': 5, 'dims': 'x'}]}):
            Daemon.answers['GET', '/api/v1/volumes'] = [answer(200, value)]
            self.assertEqual(self.run_at('volumes').returncode, 0)

    def paths(self, *states, frames=3):
        """Prepares a daemon with one path. Each state is an answer, or (state, frames done)."""
        def as_answer(s):
            return s if len(s) == 4 else answer(200, path(s[0], s[1], frames))
        Daemon.answers['POST', '/api/v1/paths'] = [answer(202, path('waiting', 0, frames))]
        Daemon.answers['GET', '/api/v1/paths/p1'] = [as_answer(s) for s in states]
        Daemon.answers['DELETE', '/api/v1/paths/p1'] = [(204, '', b'', {})]
        for n in range(frames):
            Daemon.answers['GET', f'/api/v1/paths/p1/frames/{n}'] = [(200, 'image/png', PIXELS + b'%d' % n, {})]
        self.out = os.path.join(self.folder.name, 'frames')

    def deleted(self):
        return [s[1] for s in Daemon.seen if s[0] == 'DELETE']

    def frames(self):
        for name in os.listdir(self.out):
            with open(os.path.join(self.out, name), 'rb') as f:
                self.assertEqual(f.read(), PIXELS + b'%d' % int(name.split('.')[0]))
        return sorted(os.listdir(self.out))

    def test_path(self):
        self.paths(('running', 1), ('done', 3))
        result = self.run_at('path', '-', '--out', self.out, stdin=b'{"frames": 3}')
        self.assertEqual((result.returncode, result.stderr), (0, b''))
        self.assertEqual(self.frames(), ['000000.png', '000001.png', '000002.png'])
        self.assertEqual(self.deleted(), ['/api/v1/paths/p1'])

    def test_path_tries_again(self):
        busy, cut = problem(503, 'starting'), (200, 'image/png', PIXELS, {'cut': 9})
        gone = None, '', b'', {}
        self.paths(problem(429, 'too many'), busy, gone, ('running', 1), problem(502, 'a proxy'), ('done', 3))
        Daemon.answers['GET', '/api/v1/paths/p1/frames/1'][:0] = [cut, busy]
        Daemon.answers['DELETE', '/api/v1/paths/p1'][:0] = [busy]
        result = self.run_at('path', '-', '--out', self.out, stdin=b'{}')
        self.assertEqual((result.returncode, result.stderr),
                         (0, b'splatctl: GET /paths/p1: too many (HTTP 429); trying again\n'))
        self.assertEqual(self.frames(), ['000000.png', '000001.png', '000002.png'])
        self.assertEqual(self.deleted(), ['/api/v1/paths/p1'] * 2)

    def assert_path_is_not_deleted(self, result, reason):
        text = result.stderr.decode()
        self.assertEqual((result.returncode, self.deleted()), (1, []), text)
        self.assertIn(f'"splatctl path --id p1 --out {self.out}"', text)
        self.assertIn('"splatctl path --id p1 --delete"', text)
        self.assertIn(reason, text.splitlines()[-1])

    def test_path_is_not_deleted_before_it_is_fetched(self):
        self.paths(('running', 1), ('failed', 2))
        self.assert_path_is_not_deleted(self.run_at('path', '-', '--out', self.out, stdin=b'{}'), 'splatctl: p1: frame 2: no memory')
        self.assertEqual(self.frames(), ['000000.png', '000001.png'])
        self.paths(('done', 3))
        os.mkdir(os.path.join(self.out, '000002.png'))
        self.assert_path_is_not_deleted(self.run_at('path', '-', '--out', self.out, stdin=b'{}'), '000002.png')
        os.rmdir(os.path.join(self.out, '000002.png'))
        for state in (problem(503, 'never'), (None, '', b'', {}), problem(401, 'who?')):
            self.paths(state)
            self.assert_path_is_not_deleted(self.run_at('path', '-', '--out', self.out, '--timeout', '1', stdin=b'{}'), 'splatctl: ')
        self.paths(('done', 3))
        result = self.run_at('path', '--id', 'p1', '--out', self.out)
        self.assertEqual((result.returncode, result.stderr, len(self.frames())), (0, b'', 3))
        self.assertEqual(self.deleted(), ['/api/v1/paths/p1'])

    def test_path_was_deleted(self):
        self.paths(('running', 1), problem(404, 'no path'))
        result = self.run_at('path', '-', '--out', self.out, stdin=b'{}')
        self.assertEqual((result.returncode, result.stderr),
                         (1, b'splatctl: GET /paths/p1: no path (HTTP 404)\n'))
        for more in (['--out', self.out], ['--delete'], []):
            result = self.run_at('path', '--id', 'none', *more)
            self.assertEqual((result.returncode, len(result.stderr.splitlines())), (1, 1), result.stderr)

    def test_path_interrupted(self):
        self.paths(('running', 1))
        process = subprocess.Popen([SPLATCTL, '--url', self.url, 'path', '-', '--out', self.out], stdin=subprocess.PIPE,
                                   stderr=subprocess.PIPE)
        process.stdin.write(b'{}')
        process.stdin.close()
        with Daemon.change:
            Daemon.change.wait_for(lambda: len(Daemon.seen) > 3, 60)
        process.send_signal(signal.SIGTERM)
        self.assertEqual(process.wait(60), -signal.SIGTERM)
        self.assertIn(b'"splatctl path --id p1 --delete"', process.stderr.read())
        process.stderr.close()
        self.assertEqual((self.deleted(), self.frames()), ([], ['000000.png']))

    def movie(self, *answers):
        self.paths()
        Daemon.answers['GET', '/api/v1/paths/p1'] = [answer(200, {**path('done', 3, 3), 'format': 'webm'})]
        Daemon.answers['GET', '/api/v1/paths/p1/movie'] = [(200, 'video/webm', *a) for a in answers]
        self.out = os.path.join(self.folder.name, 'movie.webm')

    def until_a_temporary_file_has_bytes(self):
        """Waits until a temporary file in the folder has bytes."""
        end = time.monotonic() + 60
        while time.monotonic() < end:
            names = os.listdir(self.folder.name)
            if any(os.path.getsize(os.path.join(self.folder.name, name)) for name in names):
                self.assertNotIn('movie.webm', names)
                self.there.set()
                return

    def test_path_movie_is_written_while_it_arrives(self):
        self.there = threading.Event()
        self.movie(([PIXELS[:70000]], {'cut': 9}), ([PIXELS, self.until_a_temporary_file_has_bytes, PIXELS], {}))
        result = self.run_at('path', '-', '--out', self.out, stdin=b'{"format": "webm"}')
        self.assertEqual(result.returncode, 0, result)
        self.assertTrue(self.there.is_set())
        self.assertEqual(os.listdir(self.folder.name), ['movie.webm'])
        with open(self.out, 'rb') as f:
            self.assertEqual(f.read(), PIXELS * 2)
        self.assertEqual(self.deleted(), ['/api/v1/paths/p1'])

    def test_path_movie_interrupted(self):
        self.there, gone = threading.Event(), threading.Event()
        self.movie(([PIXELS, self.until_a_temporary_file_has_bytes, lambda: gone.wait(60)], {'cut': 9}))
        process = subprocess.Popen([SPLATCTL, '--url', self.url, 'path', '-', '--out', self.out], stdin=subprocess.PIPE,
                                   stderr=subprocess.PIPE)
        process.stdin.write(b'{"format": "webm"}')
        process.stdin.close()
        self.assertTrue(self.there.wait(60))
        process.send_signal(signal.SIGINT)
        self.assertEqual(process.wait(60), -signal.SIGINT)
        gone.set()
        self.assertIn(b'"splatctl path --id p1 --delete"', process.stderr.read())
        process.stderr.close()
        self.assertEqual((self.deleted(), os.listdir(self.folder.name)), ([], []))

    def test_path_movie_to_a_pipe_is_not_repeated(self):
        self.movie(([PIXELS[:70000]], {'cut': 9}), ([PIXELS], {}))
        result = self.run_at('path', '-', '--out', '-', stdin=b'{"format": "webm"}')
        self.assertEqual((result.returncode, result.stdout, self.deleted()), (1, PIXELS[:70000], []))

    def test_path_that_is_refused_leaves_no_folder(self):
        self.paths()
        Daemon.answers['POST', '/api/v1/paths'] = [problem(422, 'too many', '/frames')]
        self.assertEqual(self.run_at('path', '-', '--out', self.out, stdin=b'{}').returncode, 1)
        for before in ([], [(200, 'image/png', PIXELS, {'cut': 9})]):
            self.paths(('running', 1))
            Daemon.answers['GET', '/api/v1/paths/p1/frames/0'] = before + [problem(401, 'who?')]
            self.assert_path_is_not_deleted(self.run_at('path', '-', '--out', self.out, stdin=b'{}'), 'who?')
        self.assertEqual(os.listdir(self.folder.name), [])

    def test_path_by_id(self):
        self.paths(('running', 1))
        result = self.run_at('path', '--id', 'p1')
        self.assertEqual((result.returncode, json.loads(result.stdout)), (0, path('running', 1, 3)))
        self.assertEqual(self.run_at('path', '--id', 'p1', '--delete').returncode, 0)
        self.assertEqual(self.deleted(), ['/api/v1/paths/p1'])
        Daemon.answers['GET', '/api/v1/paths'] = [answer(200, {'paths': [path('running', 1, 3)]})]
        result = self.run_at('paths')
        self.assertEqual((result.returncode, result.stdout.split()[-5:]), (0, b'p1 running png 1 3'.split()))
        for wrong in (['path'], ['path', '-', '--id', 'p1'], ['path', '-', '--delete'],
                      ['path', '--id', 'p1', '--delete', '--out', 'x'], ['paths', 'p1'], ['paths', '--delete']):
            self.assertEqual(self.run_at(*wrong).returncode, 2, wrong)

    def test_no_answer(self):
        release = threading.Event()
        held = socketserver.ThreadingTCPServer(('127.0.0.1', 0), type('Held', (socketserver.BaseRequestHandler,),
                                                                      {'handle': lambda _: release.wait(60)}))
        held.daemon_threads = True
        threading.Thread(target=held.serve_forever, daemon=True).start()
        result = run('--url', f'http://127.0.0.1:{held.server_address[1]}/', '--timeout', '1', 'volumes')
        self.assertEqual(result.returncode, 1)
        self.assertFalse(release.is_set())
        release.set()
        held.shutdown()
        held.server_close()


if __name__ == '__main__':
    unittest.main()
