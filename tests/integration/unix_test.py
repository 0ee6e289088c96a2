#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The Unix socket: HTTP, arrays in shared memory, and what is refused.

  unix_test.py SPLATD
"""
import array
import contextlib
import fcntl
import http.client
import json
import mmap
import os
import re
import signal
import socket
import stat
import struct
import subprocess
import sys
import tempfile
import threading
import unittest
import urllib.parse

DEADLINE_S = 60
SEALS = fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_WRITE
MAGIC = b'\0SPLMEM\x01'
TOKENS = 'the-token-of-the-admin-01', 'the-token-of-someone-0002', 'the-token-of-a-viewer-003'


class UnixConnection(http.client.HTTPConnection):
    def __init__(self, path):
        super().__init__('localhost', timeout=DEADLINE_S)
        self.path = path

    def connect(self):
        self.sock = socket.socket(socket.AF_UNIX)
        self.sock.settimeout(self.timeout)
        self.sock.connect(self.path)


def shared_memory(content, seals=SEALS, flags=os.MFD_ALLOW_SEALING):
    fd = os.memfd_create('array', os.MFD_CLOEXEC | flags)
    os.ftruncate(fd, len(content))
    with mmap.mmap(fd, len(content)) as memory:
        memory[:] = content
    if seals:
        fcntl.fcntl(fd, fcntl.F_ADD_SEALS, seals)
    return fd


def hello(size, token, magic=MAGIC):
    return magic + struct.pack('<QI', size, len(token)) + token.encode()


class Daemon:
    def __init__(self, test, *arguments, path=None, tcp=True, expect=0):
        self.folder = tempfile.TemporaryDirectory()
        test.addCleanup(self.folder.cleanup)
        self.path = path or os.path.join(self.folder.name, 'splatd')
        listen = ('127.0.0.1:0,' if tcp else '') + 'unix:' + self.path
        self.log = tempfile.TemporaryFile()
        test.addCleanup(self.log.close)
        self.process = subprocess.Popen([sys.argv[1], '--listen', listen, '--backend', 'null', *arguments],
                                        stdout=subprocess.PIPE, stderr=self.log)
        test.addCleanup(self.kill)
        self.lines = [self.process.stdout.readline().decode() for _ in range(2 if tcp else 1)]
        self.token = (re.findall(r'[?]token=(\w+)', self.lines[-1]) or [TOKENS[0]])[0]

    def kill(self):
        self.process.stdout.close()
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()

    def stop(self):
        self.process.send_signal(signal.SIGTERM)
        return self.process.wait(DEADLINE_S)

    def logged(self):
        self.log.seek(0)
        return self.log.read().decode(errors='replace')

    def request(self, method, target, body=None, token=None):
        connection = UnixConnection(self.path)
        with contextlib.closing(connection):
            connection.request(method, '/api/v1' + target, None if body is None else json.dumps(body),
                               {'Authorization': 'Bearer ' + (token or self.token), 'Content-Type': 'application/json'})
            answer = connection.getresponse()
            text = answer.read()
            return answer.status, json.loads(text) if text else None

    def send(self, message, descriptors=(), end=False):
        with socket.socket(socket.AF_UNIX) as s:
            s.settimeout(DEADLINE_S)
            s.connect(self.path)
            rights = [(socket.SOL_SOCKET, socket.SCM_RIGHTS, array.array('i', descriptors))] if descriptors else []
            s.sendmsg([message], rights)
            if end:
                s.shutdown(socket.SHUT_WR)
            answer = b''
            with contextlib.suppress(ConnectionResetError):
                while part := s.recv(4096):
                    answer += part
            return json.loads(answer) if answer else None

    def pass_array(self, content, token=None):
        fd = shared_memory(content)
        try:
            return self.send(hello(len(content), token or self.token), [fd])
        finally:
            os.close(fd)

    def until_loaded(self, volume, token=None):
        while True:
            status, body = self.request('GET', '/volumes/' + volume, token=token)
            if status != 200 or body['state'] != 'loading':
                return status, body


CONTENT = bytes(range(64)) * 8
DESCRIPTION = {'dims': [8, 8, 8], 'type': 'uint8'}


class Arrays(unittest.TestCase):
    def setUp(self):
        self.tokens = tempfile.NamedTemporaryFile('w', suffix='.tokens')
        self.addCleanup(self.tokens.close)
        self.tokens.write(f'{TOKENS[0]} name=admin\n{TOKENS[1]} role=control name=someone\n{TOKENS[2]} role=view name=viewer\n')
        self.tokens.flush()
        self.daemon = Daemon(self, '--token-file', self.tokens.name, '--memory', '1M')

    def open_array(self, **members):
        return self.daemon.request('POST', '/volumes', dict(DESCRIPTION, **members))

    def test_array_becomes_a_volume(self):
        memory = self.daemon.pass_array(CONTENT)['memory']
        self.assertRegex(memory, '^[0-9a-f]{32}$')
        status, body = self.open_array(memory=memory, spacing=[1, 2, 3], origin=[4, 5, 6], unit='mm', value_unit='HU',
                                       direction=[[0, 1, 0], [1, 0, 0], [0, 0, 1]], name='my array')
        self.assertEqual((status, body['id'], body['name']), (202, 'my-array', 'my array'))
        status, body = self.daemon.until_loaded('my-array')
        self.assertEqual((status, body['state']), (200, 'ready'), body)
        self.assertEqual([body[key] for key in ('dims', 'type', 'spacing', 'origin', 'unit', 'range', 'source', 'format')],
                         [[8, 8, 8], 'uint8', [1, 2, 3], [4, 5, 6], 'mm', [0, 63], 'memory:my array', 'shared memory'])
        self.assertEqual(body['direction'], [[0, 1, 0], [1, 0, 0], [0, 0, 1]])
        self.assertEqual(sum(body['histogram']['counts']), 512)
        status, body = self.open_array(memory=memory)
        self.assertEqual((status, body['pointer']), (404, '/memory'), 'an id is used once')
        status, body = self.daemon.request('POST', '/volumes', {'volume': 'my-array', 'field': 'x'})
        self.assertEqual((status, body['pointer']), (422, '/volume'))
        self.assertEqual(self.daemon.request('DELETE', '/volumes/my-array')[0], 204)
        self.assertEqual(self.daemon.stop(), 0)

    def test_all_types(self):
        for name, code, values in (('int8', 'b', [-7, 7]), ('uint16', 'H', [3, 60000]), ('int16', 'h', [-300, 300]),
                                   ('int32', 'i', [-70000, 70000]), ('float32', 'f', [-0.5, 2.5]), ('float64', 'd', [-0.25, 9e9])):
            content = array.array(code, values * 4).tobytes()
            status, body = self.open_array(memory=self.daemon.pass_array(content)['memory'], dims=[2, 2, 2], type=name, id=name)
            self.assertEqual(status, 202, body)
            self.assertEqual(self.daemon.until_loaded(name)[1]['range'], values)

    def test_an_array_belongs_to_its_token(self):
        memory = self.daemon.pass_array(CONTENT, TOKENS[1])['memory']
        status, body = self.open_array(memory=memory)
        self.assertEqual((status, body['pointer']), (404, '/memory'))
        status, body = self.daemon.request('POST', '/volumes', dict(DESCRIPTION, memory=memory), TOKENS[1])
        self.assertEqual(status, 202)
        self.assertEqual(self.daemon.pass_array(CONTENT, TOKENS[2])['status'], 403)
        self.assertEqual(self.daemon.pass_array(CONTENT, 'a-token-that-is-not-known')['status'], 401)

    def test_descriptions_that_do_not_fit(self):
        memory = self.daemon.pass_array(CONTENT)['memory']
        for members, pointer in (({'dims': [8, 8, 9]}, '/dims'), ({'dims': [8, 8]}, '/dims'), ({'type': 'uint16'}, '/dims'),
                                 ({'type': 'float16'}, '/type'), ({'spacing': [1, 0, 1]}, '/spacing'), ({'origin': 'x'}, '/origin'),
                                 ({'direction': [[2, 0, 0], [0, 1, 0], [0, 0, 1]]}, '/direction/0'), ({'unit': 7}, '/unit'),
                                 ({'meaning': 'magic'}, '/meaning'), ({'memory': 'x'}, '/memory'), ({'source': 'demo:engine'}, '/source'),
                                 ({'direction': [[1, 0, 0], [1, 0, 0], [0, 0, 1]]}, '/direction')):
            status, body = self.open_array(**dict({'memory': memory}, **members))
            self.assertEqual((status, body.get('pointer')), (422, pointer), body)
        status, body = self.daemon.request('POST', '/volumes', {'source': 'demo:engine', 'dims': [8, 8, 8]})
        self.assertEqual((status, body['pointer']), (422, '/dims'))
        self.assertEqual(self.open_array(memory=memory)[0], 202, 'a refused request does not use the array up')

    def test_more_than_the_memory(self):
        status, body = self.open_array(memory=self.daemon.pass_array(bytes(2 << 20))['memory'], dims=[128, 128, 128], id='big')
        self.assertEqual(status, 202)
        status, body = self.daemon.until_loaded('big')
        self.assertEqual(body['state'], 'failed')
        self.assertIn('--memory', body['reason'])

    def refuse(self, status, text, message, descriptors=(), **options):
        answer = self.daemon.send(message, descriptors, **options)
        self.assertEqual(answer['status'], status, answer)
        self.assertIn(text, answer['detail'])

    def test_wrong_descriptors(self):
        whole = hello(len(CONTENT), TOKENS[0])
        good, other = shared_memory(CONTENT), shared_memory(CONTENT)
        bad = [(shared_memory(CONTENT, None), 'shrink'), (shared_memory(CONTENT, fcntl.F_SEAL_SHRINK), 'change'),
               (shared_memory(CONTENT, None, 0), 'shrink'), (shared_memory(CONTENT[1:]), 'has 511 bytes')]
        for fd, text in bad:
            self.refuse(422, text, whole, [fd])
            os.close(fd)
        reading, writing = os.pipe()
        folder = os.open('/', os.O_RDONLY)
        for fd in (reading, writing, folder, socket.socket(socket.AF_UNIX).detach()):
            self.refuse(422, 'not shared memory', whole, [fd])
            os.close(fd)
        with open(sys.argv[1], 'rb') as file:
            answer = self.daemon.send(whole, [file.fileno()])
            self.assertEqual(answer['status'], 422, answer)
        self.refuse(422, 'no descriptor', whole)
        self.refuse(422, 'more than one', whole, [good, other])
        self.refuse(422, 'more than one', whole, [good] * 100)
        os.close(good)
        os.close(other)

    def test_wrong_messages(self):
        fd = shared_memory(CONTENT)
        whole = hello(len(CONTENT), TOKENS[0])
        self.refuse(400, 'begin', hello(1, TOKENS[0], b'\0SPLMEM\x02'), [fd])
        self.refuse(400, 'size of the array', hello(0, TOKENS[0]), [fd])
        self.refuse(400, 'size of the token', hello(1, 'short'), [fd])
        self.refuse(400, 'follow', whole + b'x', [fd])
        for size in (1, 8, 19, 20, len(whole) - 1):
            self.refuse(400, 'have arrived', whole[:size], [fd], end=True)
        # In parts, of which the first has the descriptor.
        with socket.socket(socket.AF_UNIX) as s:
            s.settimeout(DEADLINE_S)
            s.connect(self.daemon.path)
            s.sendmsg([whole[:1]], [(socket.SOL_SOCKET, socket.SCM_RIGHTS, array.array('i', [fd]))])
            for i in range(1, len(whole)):
                s.sendall(whole[i:i + 1])
            self.assertIn(b'memory', s.recv(4096))
        # A request of HTTP with a descriptor, which the daemon drops.
        with socket.socket(socket.AF_UNIX) as s:
            s.settimeout(DEADLINE_S)
            s.connect(self.daemon.path)
            s.sendmsg([b'GET /healthz HTTP/1.1\r\nHost: a\r\nConnection: close\r\n\r\n'],
                      [(socket.SOL_SOCKET, socket.SCM_RIGHTS, array.array('i', [fd]))])
            self.assertIn(b'200 OK', s.recv(4096))
        os.close(fd)
        self.assertEqual(self.daemon.stop(), 0)

    def test_a_flood_of_connections(self):
        """Connections that send nothing, or half a message, end when others come; no descriptor stays open."""
        folder = f'/proc/{self.daemon.process.pid}/fd'
        self.daemon.request('GET', '/volumes')
        fd = shared_memory(CONTENT)
        silent = []
        for i in range(200):
            s = socket.socket(socket.AF_UNIX)
            s.settimeout(DEADLINE_S)
            s.connect(self.daemon.path)
            silent.append(s)
            if i % 2:
                with contextlib.suppress(BrokenPipeError, ConnectionResetError):
                    s.sendmsg([MAGIC], [(socket.SOL_SOCKET, socket.SCM_RIGHTS, array.array('i', [fd]))])
        self.assertIn('memory', self.daemon.pass_array(CONTENT))
        self.assertEqual(self.daemon.request('GET', '/volumes')[0], 200)
        for s in silent[:100]:
            with contextlib.suppress(ConnectionResetError):
                self.assertEqual(s.recv(1), b'')
        before = len(os.listdir(folder))
        self.assertLess(before, 64 * 2 + 100)
        for s in silent:
            s.close()
        os.close(fd)
        self.assertEqual(self.daemon.request('GET', '/volumes')[0], 200)
        self.assertEqual(self.daemon.stop(), 0)

    def test_arrays_that_wait(self):
        for _ in range(16):
            self.assertIn('memory', self.daemon.pass_array(CONTENT, TOKENS[1]))
        self.assertEqual(self.daemon.pass_array(CONTENT, TOKENS[1])['status'], 429)
        self.assertIn('memory', self.daemon.pass_array(CONTENT))

    def test_another_user(self):
        if os.geteuid() != 0:
            self.skipTest('only root can become another user')
        os.chmod(self.daemon.folder.name, 0o755)
        fd = shared_memory(CONTENT)
        self.assertEqual(stat.S_IMODE(os.stat(self.daemon.path).st_mode), 0o600)
        for mode, expected in ((0o600, 'PermissionError'), (0o666, '403')):
            os.chmod(self.daemon.path, mode)  # the second as if an administrator had opened it
            reading, writing = os.pipe()
            child = os.fork()
            if child == 0:
                text = 'nothing'
                try:
                    os.setresuid(65534, 65534, 65534)
                    text = str(self.daemon.send(hello(len(CONTENT), TOKENS[0]), [fd])['status'])
                except Exception as error:  # the parent compares its name
                    text = type(error).__name__
                os.write(writing, text.encode())
                os._exit(0)
            os.waitpid(child, 0)
            self.assertEqual(os.read(reading, 100).decode(), expected)
            os.close(reading)
            os.close(writing)
        os.close(fd)


class Socket(unittest.TestCase):
    def test_addresses_and_file(self):
        daemon = Daemon(self)
        self.assertRegex(daemon.lines[0], r'^splatd: listening on http://127\.0\.0\.1:\d+/\?token=\w+\n$')
        self.assertEqual(daemon.lines[1], 'splatd: listening on http+unix://' + urllib.parse.quote(daemon.path, safe='') +
                         f'/?token={daemon.token}\n')
        self.assertEqual(stat.S_IMODE(os.stat(daemon.path).st_mode), 0o600)
        self.assertEqual(daemon.request('GET', '/volumes')[0], 200)
        self.assertEqual(daemon.request('GET', '/volumes', token='a-wrong-token-of-no-user')[0], 401)
        port = int(re.search(r':(\d+)/', daemon.lines[0])[1])
        connection = http.client.HTTPConnection('127.0.0.1', port, timeout=DEADLINE_S)
        with contextlib.closing(connection):
            connection.request('GET', '/healthz')
            self.assertEqual(connection.getresponse().status, 200)
        self.assertEqual(daemon.stop(), 0)
        self.assertFalse(os.path.exists(daemon.path))

    def test_alone_and_stream(self):
        daemon = Daemon(self, '--volume', 'demo:engine?size=16', tcp=False)
        self.assertRegex(daemon.lines[0], r'^splatd: listening on http\+unix://')
        while True:
            status, body = daemon.request('POST', '/sessions', {})
            if status == 201:
                break
            self.assertEqual(status, 409, body)
        with socket.socket(socket.AF_UNIX) as s:
            s.settimeout(DEADLINE_S)
            s.connect(daemon.path)
            s.sendall((f'GET /api/v1/sessions/{body["id"]}/stream?token={daemon.token} HTTP/1.1\r\nHost: localhost\r\n'
                       'Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n'
                       'Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n').encode())
            received = b''
            while b'\r\n\r\n' not in received or len(received.split(b'\r\n\r\n', 1)[1]) < 2:
                part = s.recv(65536)
                self.assertTrue(part, received)
                received += part
            self.assertTrue(received.startswith(b'HTTP/1.1 101'), received)
        self.assertEqual(daemon.stop(), 0)
        self.assertIn('user ', daemon.logged())

    def start(self, listen):
        return subprocess.run([sys.argv[1], '--listen', listen, '--backend', 'null'], capture_output=True, text=True,
                              timeout=DEADLINE_S, check=False)

    def test_paths(self):
        first = Daemon(self)
        again = self.start('unix:' + first.path)
        self.assertNotEqual(again.returncode, 0)
        self.assertIn('a program listens on this socket', again.stderr)
        self.assertEqual(first.request('GET', '/volumes')[0], 200, 'the first daemon keeps its socket')
        first.process.kill()
        first.process.wait()
        self.assertTrue(os.path.exists(first.path))
        second = Daemon(self, path=first.path)
        self.assertEqual(second.request('GET', '/volumes')[0], 200)
        self.assertEqual(second.stop(), 0)
        with open(first.path, 'w', encoding='ascii'):
            pass
        for listen, text in (('unix:' + first.path, 'no socket'), ('unix:' + '/x' * 54, '107 bytes'), ('unix:', '107 bytes'),
                             ('unix:/no/such/folder/s', 'folder'), ('unix:/tmp/a,unix:/tmp/b', 'one unix:PATH'),
                             ('127.0.0.1:0,127.0.0.1:0', 'one ADDRESS:PORT')):
            refused = self.start(listen)
            self.assertNotEqual(refused.returncode, 0, listen)
            self.assertIn(text, refused.stderr)
        self.assertTrue(os.path.exists(first.path), 'a file that is no socket stays')

    def test_nothing_survives_a_restart(self):
        with tempfile.TemporaryDirectory() as state:
            daemon = Daemon(self, '--state', state, '--volume', 'demo:engine?size=16')
            memory = daemon.pass_array(CONTENT)['memory']
            self.assertEqual(daemon.request('POST', '/volumes', dict(DESCRIPTION, memory=memory, id='gone'))[0], 202)
            self.assertEqual(daemon.until_loaded('gone')[1]['state'], 'ready')
            status, session = daemon.request('POST', '/sessions', {'view': {'volume': 'gone'}})
            self.assertEqual(status, 201, session)
            self.assertEqual(daemon.stop(), 0)
            daemon = Daemon(self, '--state', state, '--volume', 'demo:engine?size=16')
            status, body = daemon.request('GET', '/volumes/gone')
            self.assertEqual(status, 404, body)
            status, body = daemon.request('GET', '/volumes')
            self.assertNotIn('gone', [volume['id'] for volume in body['volumes']])
            status, body = daemon.request('GET', f'/sessions/{session["id"]}/snapshot')
            self.assertEqual((status, body['detail']), (409, "the session waits for its volume: there is no volume 'gone'"))
            self.assertEqual(daemon.stop(), 0)

    def test_arrays_need_the_socket(self):
        process = subprocess.Popen([sys.argv[1], '--listen', '127.0.0.1:0', '--backend', 'null'], stdout=subprocess.PIPE,
                                   stderr=subprocess.DEVNULL)
        self.addCleanup(process.stdout.close)
        self.addCleanup(process.wait)
        self.addCleanup(process.kill)
        line = process.stdout.readline().decode()
        url = urllib.parse.urlsplit(line.split()[-1])
        connection = http.client.HTTPConnection('127.0.0.1', url.port, timeout=DEADLINE_S)
        with contextlib.closing(connection):
            connection.request('POST', '/api/v1/volumes?' + url.query, json.dumps(dict(DESCRIPTION, memory='0' * 32)),
                               {'Content-Type': 'application/json'})
            answer = connection.getresponse()
            self.assertEqual(answer.status, 403)
            self.assertIn('--listen unix:PATH', json.loads(answer.read())['detail'])


if __name__ == '__main__':
    unittest.main(argv=sys.argv[:1])
