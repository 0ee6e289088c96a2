#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What splatd reports to a service manager over its socket (sd_notify(3)), and what SIGHUP changes.

  service_test.py SPLATD
"""
import fcntl
import json
import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import unittest
import urllib.error
import urllib.request

DEADLINE_S = 60
TOKENS = 'the-first-token-of-all-0001', 'the-second-token-0000000002'


class Manager:
    """Acts as systemd: a datagram socket, and the daemon started as a service."""

    def __init__(self, folder, arguments, watchdog_us=None, variables=()):
        path = os.path.join(folder, 'notify')
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.settimeout(DEADLINE_S)
        self.socket.bind(path)
        environment = dict(os.environ, NOTIFY_SOCKET=path, **dict(variables))
        environment.pop('WATCHDOG_PID', None)
        if watchdog_us:
            environment['WATCHDOG_USEC'] = str(watchdog_us)
        self.process = subprocess.Popen([sys.argv[1], '--listen', '127.0.0.1:0', '--backend', 'null', *arguments],
                                        stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment)
        self.lines, self.came = [], threading.Condition()
        self.reader = threading.Thread(target=self.read, daemon=True)
        self.reader.start()

    def read(self):
        for line in self.process.stderr:
            with self.came:
                self.lines.append(line.decode(errors='surrogateescape').rstrip('\n'))
                self.came.notify_all()

    def messages(self):
        return self.socket.recv(4096).decode().split('\n')

    def until_received(self, text):
        while True:
            received = self.messages()
            if text in received:
                return received

    def until_logged(self, text, start=0):
        with self.came:
            found = self.came.wait_for(lambda: any(text in line for line in self.lines[start:]), DEADLINE_S)
        assert found, (text, self.lines)

    def address(self):
        line = self.process.stdout.readline().decode()
        return re.search(r'http://[^/]*/', line)[0]

    def end(self):
        self.process.send_signal(signal.SIGTERM)
        received = self.until_received('STOPPING=1')
        status = self.process.wait(DEADLINE_S)
        self.reader.join(DEADLINE_S)
        self.process.stdout.close()
        self.process.stderr.close()
        self.socket.close()
        log = '\n'.join(self.lines)
        assert 'Sanitizer' not in log, log
        assert 'runtime error' not in log, log
        return status, received


class Service(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)

    def file(self, name, text):
        path = os.path.join(self.folder.name, name)
        with open(path, 'w', encoding='utf-8') as f:
            f.write(text)
        return path

    def test_ready_reload_and_stop(self):
        manager = Manager(self.folder.name, ['--volume', 'demo:engine?size=8'])
        ready = manager.messages()
        self.assertEqual(ready[0], 'READY=1')
        self.assertRegex(ready[1], '^STATUS=listening on 127.0.0.1')
        self.assertNotIn('token', ready[1])
        urllib.request.urlopen(manager.address() + 'healthz', timeout=DEADLINE_S).close()
        before_us = time.clock_gettime_ns(time.CLOCK_MONOTONIC) // 1000
        manager.process.send_signal(signal.SIGHUP)
        reloading = manager.messages()
        self.assertEqual(reloading[0], 'RELOADING=1')
        stamp = int(re.fullmatch(r'MONOTONIC_USEC=(\d+)', reloading[1])[1])
        self.assertLessEqual(before_us, stamp)
        self.assertLessEqual(stamp, time.clock_gettime_ns(time.CLOCK_MONOTONIC) // 1000)
        self.assertEqual(manager.messages()[0], 'READY=1')
        status, stopping = manager.end()
        self.assertEqual(status, 0)
        self.assertEqual(stopping[0], 'STOPPING=1')

    def test_watchdog(self):
        manager = Manager(self.folder.name, [], watchdog_us=400000)
        manager.until_received('READY=1')
        for _ in range(5):
            self.assertEqual(manager.messages(), ['WATCHDOG=1'])
        manager.process.send_signal(signal.SIGHUP)  # a reload in between does not end it
        manager.until_received('READY=1')
        manager.until_received('WATCHDOG=1')
        self.assertEqual(manager.end()[0], 0)

    @unittest.skipIf(os.environ.get('SPLATD_SANITIZE'), 'the sanitizers want to be preloaded themselves')
    def test_a_daemon_that_hangs_sends_no_watchdog_message(self):
        hold = self.file('hold', '')
        manager = Manager(self.folder.name, [], watchdog_us=4000000,
                          variables={'LD_PRELOAD': os.environ['SPLATD_HOLD_EPOLL'], 'SPLATD_HOLD': hold})
        manager.until_received('READY=1')
        manager.until_received('WATCHDOG=1')
        with open(hold, encoding='utf-8') as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)  # the stream thread hangs
            manager.until_logged('the stream or timer thread was blocked for', len(manager.lines))
            received = []
            for _ in range(2):  # the main thread goes on, and says nothing between the two but this
                manager.process.send_signal(signal.SIGHUP)
                received = [manager.messages()]
                while received[-1][0] != 'READY=1':
                    received.append(manager.messages())
            self.assertEqual([message[0] for message in received], ['RELOADING=1', 'READY=1'])
        manager.until_received('WATCHDOG=1')
        self.assertEqual(manager.end()[0], 0)

    def status_with(self, address, token):
        request = urllib.request.Request(address + 'api/v1/volumes', headers={'Authorization': f'Bearer {token}'})
        try:
            with urllib.request.urlopen(request, timeout=DEADLINE_S) as answer:
                return answer.status
        except urllib.error.HTTPError as e:
            e.close()
            return e.code

    def test_what_sighup_changes(self):
        token, config = self.file('token', TOKENS[0]), self.file('config', 'log-level = info\nsessions = 5\n')
        manager = Manager(self.folder.name, ['--token-file', token, '--config', config])
        manager.until_received('READY=1')
        address = manager.address()
        self.assertEqual([self.status_with(address, t) for t in TOKENS], [200, 401])
        self.file('token', TOKENS[1])
        self.file('config', 'log-level = debug\nsessions = 6\n')
        manager.process.send_signal(signal.SIGHUP)
        manager.until_received('READY=1')
        manager.until_logged('the setting sessions has changed and takes effect at the next start')
        self.assertEqual([self.status_with(address, t) for t in TOKENS], [401, 200])
        manager.until_logged('level=debug')
        # An unreadable file changes nothing.
        for name, text, why in (('config', 'nonsense = 1\n', "unknown setting 'nonsense'"),
                                ('token', 'short', '16 to 128')):
            start = len(manager.lines)
            with open(os.path.join(self.folder.name, name), encoding='utf-8') as f:
                old = f.read()
            self.file(name, text)
            manager.process.send_signal(signal.SIGHUP)
            manager.until_received('READY=1')
            manager.until_logged(why, start)
            self.file(name, old)
            self.assertEqual([self.status_with(address, t) for t in TOKENS], [401, 200])
        self.assertFalse(any('log-level' in line for line in manager.lines))
        self.assertEqual(manager.end()[0], 0)

    def test_formats_of_the_log(self):
        stamp = r'\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z'
        for form, pattern in (('text', rf'{stamp} info .+'), ('logfmt', rf'time={stamp} level=info (volume="[^"]+" )?msg=".+"')):
            manager = Manager(tempfile.mkdtemp(dir=self.folder.name), ['--log-format', form])
            manager.until_received('READY=1')
            self.assertEqual(manager.end()[0], 0)
            for line in manager.lines:
                self.assertRegex(line, f'^{pattern}$')
            self.assertTrue(manager.lines)
        manager = Manager(tempfile.mkdtemp(dir=self.folder.name), ['--log-format', 'json', '--log-level', 'debug', '--volume', 'demo:phantom?size=8'])
        manager.until_received('READY=1')
        manager.until_logged('volume phantom loaded')
        with self.assertRaises(urllib.error.HTTPError) as refused:
            urllib.request.urlopen(manager.address() + 'a%22%5C%FF%C3%A9', timeout=DEADLINE_S)
        refused.exception.close()
        self.assertEqual(manager.end()[0], 0)
        lines = [json.loads(line) for line in manager.lines]
        for line in lines:
            self.assertLessEqual({'time', 'level', 'msg'}, set(line))
            self.assertLessEqual(set(line), {'time', 'level', 'volume', 'session', 'path', 'peer', 'msg'})
            self.assertRegex(line['time'], f'^{stamp}$')
        self.assertTrue(any('/a"\\?é' in line['msg'] for line in lines), lines)
        self.assertTrue(any(line.get('volume') == 'phantom' and ' loaded: ' in line['msg'] for line in lines), lines)


if __name__ == '__main__':
    unittest.main(argv=sys.argv[:1], verbosity=2)
