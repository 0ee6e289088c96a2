#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""splatctl_path_test.py SPLATCTL: camera paths, which are fetched from a daemon that fails now and then."""
import json
import os
import signal
import subprocess
import threading
import time
import unittest

from fake_daemon import PIXELS, SPLATCTL, Daemon, RemoteCase, answer, path, problem


class Paths(RemoteCase):
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
        self.assertEqual((result.returncode, result.stderr, len(self.frames()), self.deleted()), (0, b'', 3, []))
        result = self.run_at('path', '--id', 'p1', '--out', self.out, '--delete')
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
                      ['path', '-', '--out', 'x', '--delete'], ['paths', 'p1'], ['paths', '--delete']):
            self.assertEqual(self.run_at(*wrong).returncode, 2, wrong)


if __name__ == '__main__':
    unittest.main()
