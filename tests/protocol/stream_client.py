# SPDX-License-Identifier: Apache-2.0
"""A small WebSocket client (RFC 6455) of one stream for tests: JSON-RPC calls, notifications, acknowledgements."""
import base64
import json
import os
import socket
import struct

TEXT, BINARY, CLOSE, PING, PONG = 1, 2, 8, 9, 10


class Stream:
    """Acknowledges frames at once. `notes`: the notifications so far; `closed`: the close code, None while open."""

    def __init__(self, host, session, token, deadline_s=60):
        name, port = host.rsplit(':', 1)
        self.socket = socket.create_connection((name, int(port)), timeout=deadline_s)
        self.notes, self.frames, self.closed = [], 0, None
        self.answers, self.last_id = {}, 0
        key = base64.b64encode(os.urandom(16)).decode()
        self.socket.sendall((f'GET /api/v1/sessions/{session}/stream?token={token} HTTP/1.1\r\nHost: {host}\r\n'
                             f'Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: {key}\r\n'
                             'Sec-WebSocket-Version: 13\r\n\r\n').encode())
        self.buffer = b''
        while b'\r\n\r\n' not in self.buffer:
            self._receive()
        head, self.buffer = self.buffer.split(b'\r\n\r\n', 1)
        if not head.startswith(b'HTTP/1.1 101'):
            raise RuntimeError(head.decode())

    def _receive(self):
        data = self.socket.recv(1 << 16)
        if not data:
            raise EOFError('the stream ended')
        self.buffer += data

    def _take(self, count):
        while len(self.buffer) < count:
            self._receive()
        data, self.buffer = self.buffer[:count], self.buffer[count:]
        return data

    def send(self, text, opcode=TEXT):
        data, mask = text if isinstance(text, bytes) else text.encode(), os.urandom(4)
        size = len(data)
        head = struct.pack('!BB', 0x80 | opcode, 0x80 | size) if size < 126 else (
            struct.pack('!BBH', 0x80 | opcode, 0xfe, size) if size < 65536 else struct.pack('!BBQ', 0x80 | opcode, 0xff, size))
        self.socket.sendall(head + mask + bytes(byte ^ mask[i & 3] for i, byte in enumerate(data)))

    def read(self):
        """Reads and handles one message."""
        first, second = self._take(2)
        size = second & 127
        if size > 125:
            size = struct.unpack('!H' if size == 126 else '!Q', self._take(2 if size == 126 else 8))[0]
        data, opcode = self._take(size), first & 15
        if opcode == PING:
            self.send(data, PONG)
        elif opcode == CLOSE:
            self.closed = struct.unpack('!H', data[:2])[0] if size >= 2 else 1005
        elif opcode == BINARY:
            self.frames = struct.unpack('<I', data[8:12])[0]
            self.send(json.dumps({'jsonrpc': '2.0', 'method': 'stream.ack', 'params': {'frame': self.frames}}))
        else:
            message = json.loads(data)
            if 'method' in message:
                self.notes.append(message)
            else:
                self.answers[message['id']] = message

    def ask(self, message):
        """Sends a message, an object without an id, and returns its answer."""
        self.last_id += 1
        self.send(json.dumps({'jsonrpc': '2.0', 'id': self.last_id, **message}))
        while self.last_id not in self.answers:
            self.read()
        return self.answers.pop(self.last_id)

    def note(self, method):
        """Waits for a notification of that method, unless one has arrived already."""
        while not any(note['method'] == method for note in self.notes):
            self.read()

    def end(self):
        """Reads until the daemon closes the stream."""
        try:
            while self.closed is None:
                self.read()
        except EOFError:
            pass
        self.socket.close()
