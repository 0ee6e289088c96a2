#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""splatctl_test.py SPLATCTL: usage, rendering in process, and the handling of answers of a daemon."""
import json
import os
import re
import socketserver
import struct
import tempfile
import threading
import unittest
import zlib

from fake_daemon import PIXELS, Daemon, RemoteCase, answer, problem, run, volume


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

    def test_help_of_one_command(self):
        whole = run('--help').stdout.decode()
        self.assertLessEqual(max(map(len, whole.split('\n'))), 100)
        for command in sorted(set(re.findall(r'^  ([a-z]+) ', whole.split('\n\n')[1], re.MULTILINE))):
            with self.subTest(command):
                part = run(command, '--help').stdout.decode()
                self.assertRegex(part, rf'\n  {command} ')
                self.assertEqual('--url' in part, command not in ('info', 'convert'))
                self.assertEqual('--origin' in part, command == 'slice')
                self.assertEqual('--azimuth' in part, command in ('render', 'save', 'share'))
                for line in part.split('\n')[4:]:
                    self.assertIn(line, whole)

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
        for size in ('0', '0,5', '5,0', '8193', '8193x1', '5x', 'x5', '5*5', '5,5,5', '5x5x5', '-1,5', ' 5,5', ',', '',
                     '99999999999999999999,1'):
            self.refused('render', '--volume', 'a', '--out', 'x.png', '--size', size)
        for quality in ('0', '101', 'high', '', '50%'):
            self.refused('render', '--volume', 'a', '--out', 'x.png', '--quality', quality)
        for option in ('--azimuth', '--elevation', '--distance', '--roll'):
            for value in ('', 'left', '5deg', 'nan', 'inf'):
                self.assertIn(option, self.refused('render', '--volume', 'a', '--out', 'x.png', option, value))
        for surface in ('', 'high', 'nan', '1,', '1,red', '1,fff', '1,#ff00001', '1,ffffff,', '1,ffffff,1.5', '1,ffffff,-0.1', '1,ffffff,1,1', '1e999'):
            self.assertIn('--surface', self.refused('render', '--volume', 'a', '--out', 'x.png', '--surface', surface))
        self.assertIn('8 layers', self.refused('render', '--volume', 'a', '--out', 'x.png', *['--surface', '1'] * 9))
        for shell in ('', '0.1', '0.1,', '0.5,0.2', '-0.1,1', '0,1.1', '0,1,slow', '0,1,fast,', '0 ,1'):
            self.assertIn('--shell', self.refused('render', '--volume', 'a', '--out', 'x.png', '--shell', shell))
        for vectors in ('', 'dense', 'blend,', 'blend,0.9', 'blend,9', 'blend,2,', 'blend,2,1.1', 'blend,2,0.5,', 'modulate ,2', 'blend,2,-1', 'blen'):
            self.assertIn('--vectors', self.refused('render', '--volume', 'a', '--out', 'x.png', '--vectors', vectors))
        self.assertIn('one layer of vectors', self.refused('render', '--volume', 'a', '--out', 'x.png', *['--vectors', 'blend'] * 2))
        self.assertIn('one shell', self.refused('render', '--volume', 'a', '--out', 'x.png', *['--shell', '0,1'] * 2))
        for mode in ('', 'Maximum', 'sheet', 'sum '):
            self.assertIn('--projection', self.refused('render', '--volume', 'a', '--out', 'x.png', '--projection', mode))
        for window in ('', '1', '1,', ',1', '1,0', '1,-2', '1,2,3', '1,2 ', '1;2', 'nan,1', '1,inf', '1e999,1'):
            self.assertIn('--window', self.refused('render', '--volume', 'a', '--out', 'x.png', '--window', window))
        self.refused('render', '--local', '--volume', 'a', '--out', 'x.png', '--preset', 'bones')
        self.refused('unload')
        self.refused('convert', 'demo:engine')
        self.refused('convert', 'demo:engine', 'a.bricks', 'b.bricks')
        self.assertIn('.nrrd', self.refused('convert', 'demo:engine', 'a.obj'))


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
        for size, expected in (('7,9', (7, 9)), ('9x7', (9, 7)), ('8', (8, 8))):
            self.assertEqual(png_size(self.render('-', '--view', '-', '--size', size, stdin=view).stdout), expected)

    def test_the_camera_by_angles(self):
        def image(*arguments, view=b'{}'):
            result = self.render('-', '--volume', 'demo:engine?size=16', '--size', '32', '--view', '-', *arguments, stdin=view)
            self.assertEqual((result.returncode, result.stderr), (0, b''))
            return result.stdout
        right = image('--azimuth', '90', '--elevation', '-20', '--distance', '40', '--roll', '7')
        self.assertEqual(image(view=b'{"camera": {"azimuth": 90, "elevation": -20, "distance": 40, "roll": 7}}'), right)
        self.assertEqual(image('--azimuth', '90', view=b'{"camera": {"azimuth": 5, "elevation": -20, "distance": 40, "roll": 7}}'),
                         right)
        self.assertNotEqual(image(), right)
        self.refused('/camera/elevation: 95 is outside', '--volume', 'demo:engine?size=16', '--elevation', '95')

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

    def test_convert(self):
        data = bytes(i * 7 % 256 for i in range(70 * 3 * 2))
        with open(self.path('a.nrrd'), 'wb') as f:
            f.write(b'NRRD0004\ntype: uint8\ndimension: 3\nsizes: 70 3 2\nencoding: raw\n\n' + data)
        for source in (self.path('a.nrrd'), 'demo:engine?size=70', 'demo:turbulence?size=8'):
            result = run('convert', source, self.path('a.bricks'))
            self.assertEqual((result.returncode, result.stderr, result.stdout), (0, b'', b''))
            with open(self.path('a.bricks'), 'rb') as f:
                self.assertEqual(f.read(8), b'SPBRICK\n')
        self.assertEqual(run('convert', self.path('a.nrrd'), self.path('b.nrrd')).returncode, 0)
        with open(self.path('b.nrrd'), 'rb') as f:
            text = f.read()
        self.assertEqual(text[-len(data):], data)
        with open(self.path('b.nrrd'), 'wb') as f:
            f.write(text.replace(b'origin: (0,', b'origin: (9,'))
        result = run('convert', self.path('b.nrrd'), self.path('b.nii'))  # a place, but no anatomy
        self.assertEqual(result.returncode, 0)
        self.assertIn('right, anterior and superior', result.stderr.decode())
        for name in ('b.nrrd', 'b.nii'):
            os.remove(self.path(name))
        self.assertEqual(sorted(os.listdir(self.folder.name)), ['a.bricks', 'a.nrrd'])
        for source, out, why in (('/no/such.nrrd', 'a.bricks', '/no/such.nrrd: '), ('demo:nothing', 'a.bricks', 'demo:nothing: '),
                                 ('demo:galaxy', 'missing/a.bricks', 'cannot write into the folder'),
                                 ('demo:points?size=20', 'a.bricks', 'only grids of samples can be converted'), ('demo:engine?size=4097', 'a.bricks', '[8, 4096]')):
            result = run('convert', source, self.path(out))
            self.assertEqual(result.returncode, 1)
            self.assertIn(why, result.stderr.decode())


class Remote(RemoteCase):
    def test_volumes(self):
        Daemon.answers['GET', '/api/v1/volumes'] = [answer(200, {'volumes': [
            volume('ready', dims=[4, 5, 6], type='uint8', bytes=120), volume('loading')]})]
        result = self.run_at('volumes')
        self.assertEqual((result.returncode, result.stderr), (0, b''))
        self.assertIn('4x5x6', result.stdout.decode())
        self.assertEqual(len(result.stdout.splitlines()), 3)
        self.assertEqual(json.loads(self.run_at('volumes', '--json').stdout)['volumes'][1]['state'], 'loading')
        self.assertEqual(Daemon.seen[0][2]['Authorization'], 'Bearer secret')

    def test_tables_align_whatever_the_names(self):
        names = ['short', 'größe', 'a-name-of-more-than-twenty-four-letters', '体积', 'e\u0301', 'red\x1b[31m\u0085']
        Daemon.answers['GET', '/api/v1/volumes'] = [answer(200, {'volumes': [
            {**volume('ready', dims=[4, 5, 6], type='uint8', bytes=120 * 10**i), 'id': name} for i, name in enumerate(names)]})]
        lines = self.run_at('volumes').stdout.decode().splitlines()
        width = {'体': 2, '积': 2, '\u0301': 0}
        def column_of(line, text):
            return sum(width.get(c, 1) for c in line[:line.index(text)])
        self.assertEqual({column_of(line, 'ready') for line in lines[1:]}, {len(names[2]) + 2})
        self.assertEqual({column_of(line, 'head.nrrd') for line in lines[1:]}, {column_of(lines[0], 'SOURCE')})
        self.assertEqual(column_of(lines[0], 'STATE'), len(names[2]) + 2)
        self.assertIn('red?[31m??', lines[6])  # a name commands no terminal
        self.assertEqual(lines[0].split(), ['ID', 'STATE', 'SIZE', 'TYPE', 'MB', 'SOURCE'])

    def test_unload(self):
        Daemon.answers['DELETE', '/api/v1/volumes/a%2Fb'] = [(204, '', b'', {})]
        result = self.run_at('unload', 'a/b')
        self.assertEqual((result.returncode, result.stdout, result.stderr, self.deleted()), (0, b'', b'', ['/api/v1/volumes/a%2Fb']))
        result = self.run_at('unload', 'none')
        self.assertEqual((result.returncode, result.stderr), (1, b'splatctl: DELETE /volumes/none: there is nothing (HTTP 404)\n'))

    def test_https_at_a_server_without_tls(self):
        result = run('--url', self.url.replace('http:', 'https:') + '/?token=secret', 'volumes')
        self.assertEqual((result.returncode, result.stdout), (1, b''))
        self.assertEqual(result.stderr.decode(), f'splatctl: {self.url.replace("http:", "https:")}: this server speaks HTTP '
                         f'without TLS; use {self.url}\n')
        self.assertEqual([s[2]['Authorization'] for s in Daemon.seen], [None])  # the token went nowhere

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
        self.assertEqual(self.run_at('view', 'a/b', '--json').stdout, b'{"size":[1,2]}\n')
        self.assertEqual(self.run_at('view', 'a/b').stdout, b'{\n  "size": [1, 2]\n}\n')
        value = {'text': 'a: "b, c", \\', 'empty': [{}, []], 'points': [{'value': i / 3, 'color': [0.1234567, 1, 0]} for i in range(9)],
                 'deep': {'list': [[[0.1] * 60, [1]]]}, 'no': None}
        Daemon.answers['GET', '/api/v1/volumes/a%2Fb/view'] = [answer(200, value)]
        text = self.run_at('view', 'a/b').stdout.decode()
        self.assertEqual(json.loads(text), value)
        self.assertIn('\n    {"value": 0, "color": [0.1234567, 1, 0]},\n', text)  # a point per line
        self.assertIn('\n  "text": "a: \\"b, c\\", \\\\",\n  "empty": [{}, []],\n', text)
        self.assertLessEqual(max(map(len, text.splitlines())), 100)
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

    def test_an_image_that_is_not_complete(self):
        for complete, level, lost, note in (
                ('true', 1, 0, ''),
                ('false', 1, 0, f'splatctl: {self.out}: parts of the image are coarse'),
                ('false', 3, 0, f'splatctl: {self.out}: the image is coarser than its pixels: level 3 of the volume instead of 1'),
                ('false', 3, 2, f'splatctl: {self.out}: 2 bricks of the volume are damaged')):
            self.reply_image(**{'X-Complete': complete, 'X-Level': str(level), 'X-Level-Asked': '1', 'X-Bricks-Lost': str(lost)})
            result = self.run_at('render', '--volume', 'head', '--out', self.out, '--json')
            self.assertEqual(result.returncode, 0)
            self.assertEqual(result.stderr.decode()[:len(note) or None], note)
            report = json.loads(result.stdout)
            self.assertEqual([report[key] for key in ('complete', 'level', 'asked', 'lost')], [complete == 'true', level, 1, lost])

    def test_render_with_a_preset(self):
        self.reply_image()
        Daemon.answers['GET', '/api/v1/presets/my%20bones'] = [answer(200, {
            'camera': {'fov_y': 12, 'near': 3}, 'transfer_function': {'points': [1, 2, 3], 'order': 'pre'}, 'filter': None})]
        view = {'camera': {'fov_y': 40}, 'transfer_function': {'points': [4], 'order': None}, 'clip': {'planes': []}}
        result = self.run_at('render', '--volume', 'head', '--preset', 'my bones', '--view', '-', '--out', self.out, '--roll', '-3',
                             stdin=json.dumps(view).encode())
        self.assertEqual((result.returncode, result.stderr), (0, b''))
        self.assertEqual(json.loads(Daemon.seen[-1][3]), {
            'volume': 'head', 'camera': {'fov_y': 40, 'near': 3, 'roll': -3}, 'filter': None, 'clip': {'planes': []},
            'transfer_function': {'points': [4], 'order': None}})
        result = self.run_at('render', '--volume', 'head', '--preset', 'none', '--out', self.out)
        self.assertEqual((result.returncode, result.stderr), (1, b'splatctl: GET /presets/none: there is nothing (HTTP 404)\n'))

    def test_layers(self):
        self.reply_image()
        volume, surface = {'type': 'volume'}, {'type': 'surface', 'value': 120}
        shell = {'type': 'shell', 'low': 0.05, 'high': 0.9, 'detail': 'high'}
        own = {**surface, 'value': 7, 'flatness': 3}
        vectors = {'type': 'vectors', 'style': 'modulate'}
        cases = (
            ([], None, None),
            (['--surface', '120'], None, [volume, surface]),
            (['--surface', '120'], {'layers': None}, [volume, surface]),
            (['--surface', '-1e3,#ff8040,0.5', '--surface', '120,,0.25'], None,
             [volume, {'type': 'surface', 'value': -1000, 'color': [1, 128 / 255, 64 / 255], 'opacity': 0.5}, {**surface, 'opacity': 0.25}]),
            (['--shell', '0.05,0.9'], None, [volume, shell]),
            (['--no-volume', '--shell', '0.05,0.9,fast'], None, [{**shell, 'detail': 'fast'}]),
            (['--no-volume', '--shell', '0.05,0.9', '--surface', '120'], None, [surface, shell]),
            (['--surface', '120'], {'layers': [own, {'type': 'shell'}]}, [own, {'type': 'shell'}, surface]),
            (['--shell', '0.05,0.9'], {'layers': [own, {'type': 'shell'}]}, [own, shell]),
            (['--no-volume'], {'layers': [{**volume, 'visible': False}, own]}, [own]),
            (['--vectors', 'blend'], None, [{**vectors, 'style': 'blend'}]),
            (['--vectors', 'blend'], {'layers': [volume]}, [volume, {**vectors, 'style': 'blend'}]),
            (['--vectors', 'blend', '--surface', '120'], None, [surface, {**vectors, 'style': 'blend'}]),
            (['--vectors', 'blend', '--color-by', 'magnitude'], None, [{**vectors, 'style': 'blend', 'color_by': 'magnitude'}]),
            (['--color-by', 'magnitude'], {'layers': [own, {'type': 'points'}]}, [own, {'type': 'points', 'color_by': 'magnitude'}]),
            (['--color-by', 'head'], {'layers': [vectors]}, [{**vectors, 'color_by': 'head'}]),
            (['--vectors', 'modulate,3'], {'layers': [own, {**vectors, 'phase': 0.5}]}, [own, {**vectors, 'stretch': 3}]),
            (['--no-volume', '--vectors', 'modulate,1,0.25', '--shell', '0.05,0.9'], None, [shell, {**vectors, 'stretch': 1, 'density': 0.25}]),
        )
        for options, view, layers in cases:
            with self.subTest(options=options, view=view):
                result = self.run_at('render', '--volume', 'head', '--out', self.out, *(['--view', '-'] if view else []), *options,
                                     stdin=json.dumps(view).encode())
                self.assertEqual((result.returncode, result.stderr), (0, b''))
                self.assertEqual(json.loads(Daemon.seen[-1][3]).get('layers'), layers)
        result = self.run_at('render', '--volume', 'head', '--out', self.out, '--no-volume')
        self.assertEqual((result.returncode, result.stderr),
                         (1, b'splatctl: --no-volume: leaves nothing to draw: add --surface, --shell, --vectors or --channel\n'))
        result = self.run_at('render', '--volume', 'head', '--out', self.out, '--surface', '1', '--color-by', 'magnitude')
        self.assertEqual((result.returncode, result.stderr),
                         (1, b'splatctl: --color-by: needs --vectors, or a view with layers of vectors or points\n'))
        result = self.run_at('render', '--volume', 'head', '--out', self.out, '--surface', '1', '--view', '-', stdin=b'{"layers": 5}')
        self.assertEqual((result.returncode, result.stderr), (1, b'splatctl: /layers: must be an array, not a number\n'))

    def test_channels(self):
        self.reply_image()
        volume = {'type': 'volume'}
        green, magenta, cyan, red = [0, 1, 0], [1, 0, 1], [0, 1, 1], [1, 0, 0]
        point = lambda value, opacity, color: {'value': value, 'opacity': opacity, 'color': color}
        channel = lambda color, *points: {'type': 'channel', 'id': 'head', 'color': color, **({'points': list(points)} if points else {})}
        cases = (
            (['--channel', 'head'], {}, [volume, channel(green)]),
            (['--channel', 'head,#ff0000'], {}, [volume, channel(red)]),
            (['--channel', 'head,ff0000,-5,1e3'], {}, [volume, channel(red, point(-5, 0, red), point(1000, 0.5, red))]),
            (['--channel', 'head,,1,2,0.9'], {}, [volume, channel(green, point(1, 0, green), point(2, 0.9, green))]),
            (['--channel', 'head', '--channel', 'head,00ff00', '--channel', 'head'], {}, [volume, channel(magenta), channel(green), channel(cyan)]),
            (['--channel', 'head'], {'layers': [channel(magenta, point(1, 0, green))]}, [channel(magenta, point(1, 0, green)), channel(cyan)]),
            (['--channel', 'head'], {'transfer_function': {'points': [point(0, 0, red), point(1, 0.5, green)]}}, [volume, channel(magenta)]),
            (['--no-volume', '--channel', 'head', '--surface', '3'], {}, [{'type': 'surface', 'value': 3}, channel(green)]),
        )
        for options, view, layers in cases:
            with self.subTest(options=options, view=view):
                result = self.run_at('render', '--volume', 'head', '--out', self.out, '--view', '-', *options, stdin=json.dumps(view).encode())
                self.assertEqual((result.returncode, result.stderr), (0, b''))
                sent = json.loads(Daemon.seen[-1][3])
                self.assertEqual(sent['layers'], layers)
                self.assertNotIn('compositing', sent)
        # A field that is named after a colour has it. The daemon loads the source.
        for name, color in (('rgb%20Red', red), ('green', green), ('rgb_blue', [0, 0, 1]), ('blues', green), ('predicted', green), ('red%20dye', green)):
            Daemon.answers['POST', '/api/v1/volumes'] = Daemon.answers['GET', '/api/v1/volumes/head']
            result = self.run_at('render', '--volume', 'head', '--out', self.out, '--channel', f'head.nrrd?field={name}')
            self.assertEqual((result.returncode, result.stderr), (0, b''))
            self.assertEqual(json.loads(Daemon.seen[-1][3])['layers'], [volume, channel(color)])
        # A projection is in colour, unless the view or the projection says something else.
        for options, compositing, colors in ((['maximum'], {}, 'transfer_function'), (['maximum'], {'colors': 'grey'}, 'grey'), (['sum'], {}, None)):
            result = self.run_at('render', '--volume', 'head', '--out', self.out, '--view', '-', '--channel', 'head', '--projection', *options,
                                 stdin=json.dumps({'compositing': compositing}).encode())
            self.assertEqual((result.returncode, result.stderr), (0, b''))
            self.assertEqual(json.loads(Daemon.seen[-1][3])['compositing'].get('colors'), colors)
        for text in (b'', b',00ff00', b'head,', b'head,green', b'head,00ff00,1', b'head,00ff00,2,1', b'head,00ff00,1,2,1', b'head,00ff00,1,2,0.5,7'):
            with self.subTest(text=text):
                result = self.run_at('render', '--volume', 'head', '--out', self.out, '--channel', text)
                self.assertEqual(result.returncode, 2)
                self.assertIn(b'splatctl: --channel: "' + text + b'" is not SOURCE[,COLOR[,LOW,HIGH[,OPACITY]]]', result.stderr)
        result = self.run_at('render', '--volume', 'head', '--out', self.out, *['--channel', 'head'] * 8)
        self.assertEqual((result.returncode, result.stderr),
                         (2, b'splatctl: --channel: a view has at most 7 channels beside the volume; see splatctl --help\n'))

    def test_projections(self):
        self.reply_image()
        cases = (
            ([], None, None),
            (['--projection', 'sum'], None, {'mode': 'sum', 'window': {}}),
            (['--projection', 'mean', '--window', '-1e1,2.5'], None, {'mode': 'mean', 'window': {'center': -10, 'width': 2.5}}),
            (['--window', '1,2'], {'compositing': {'mode': 'mean', 'window': None, 'zero': 3}},
             {'mode': 'mean', 'window': {'center': 1, 'width': 2}, 'zero': 3}),
            (['--projection', 'sum'], {'compositing': {'mode': 'mean', 'window': {'center': 1}, 'zero': 3}}, {'mode': 'sum', 'window': {}, 'zero': 3}),
            (['--projection', 'sum'], {'compositing': None}, {'mode': 'sum', 'window': {}}),
        )
        for options, view, compositing in cases:
            with self.subTest(options=options, view=view):
                result = self.run_at('render', '--volume', 'head', '--out', self.out, *(['--view', '-'] if view else []), *options,
                                     stdin=json.dumps(view).encode())
                self.assertEqual((result.returncode, result.stderr), (0, b''))
                self.assertEqual(json.loads(Daemon.seen[-1][3]).get('compositing'), compositing)

    def test_render_says_which_volumes_exist(self):
        Daemon.answers['POST', '/api/v1/volumes'] = [problem(404, 'no such file', '/path')]
        Daemon.answers['GET', '/api/v1/volumes'] = [answer(200, {'volumes': [{'id': 'head'}, {'id': 'engine'}]})]
        def text():
            result = self.run_at('render', '--volume', 'nosuch', '--out', self.out)
            self.assertEqual((result.returncode, len(result.stderr.splitlines())), (1, 1))
            return result.stderr.decode()
        self.assertEqual(text(), 'splatctl: nosuch: no volume has this id (the daemon has head, engine), and loading it fails: '
                                 'no such file (HTTP 404)\n')
        Daemon.answers['GET', '/api/v1/volumes'] = [answer(200, {'volumes': [{'id': f'volume-{i}'} for i in range(1000)]})]
        self.assertRegex(text(), r'has volume-0, volume-1, .* and 9\d\d more\), and loading it fails')
        Daemon.answers['GET', '/api/v1/volumes'] = [answer(200, {'volumes': []})]
        self.assertIn('(the daemon has no volumes)', text())
        Daemon.answers['GET', '/api/v1/volumes/nosuch'] = [problem(403, 'not yours')]
        self.assertEqual(text(), 'splatctl: GET /volumes/nosuch: not yours (HTTP 403)\n')

    def test_render_loads_a_source(self):
        self.reply_image()
        Daemon.answers['POST', '/api/v1/volumes'] = [answer(202, volume('loading'))]
        Daemon.answers['GET', '/api/v1/volumes/head%201'] = [answer(200, volume('ready'))]
        self.assertEqual(self.run_at('render', '--volume', 'demo:engine', '--out', self.out).returncode, 0)
        self.assertEqual(json.loads(Daemon.seen[-1][3])['volume'], 'head 1')
        self.assertEqual(self.run_at('render', '--volume', 'new.nrrd', '--out', self.out).returncode, 0)
        self.assertEqual([s[:2] for s in Daemon.seen[-4:-2]],
                         [('GET', '/api/v1/volumes/new.nrrd'), ('POST', '/api/v1/volumes')])

    def test_slice(self):
        Daemon.answers['GET', '/api/v1/volumes/head'] = [answer(200, {**volume('ready'), 'id': 'head', 'dims': [10, 21, 30]})]
        Daemon.answers['GET', '/api/v1/volumes/head/slice'] = [(200, 'image/png', PIXELS, {})]

        def query(*arguments):
            result = self.run_at('slice', '--volume', 'head', '--out', self.out, *arguments)
            self.assertEqual((result.returncode, result.stdout, result.stderr), (0, b'', b''))
            with open(self.out, 'rb') as f:
                self.assertEqual(f.read(), PIXELS)
            return Daemon.seen[-1][1].split('?')[1]
        self.assertEqual(query('--axis', 'y'), 'format=png&axis=1&index=10')
        self.assertEqual(query('--axis', '2', '--index', '7', '--window', '100,2e3', '--format', 'raw'),
                         'format=raw&axis=2&index=7&window=100%2C2e3')
        self.assertEqual(query('--origin', '1,2,3', '--normal', '0,-1,0', '--up', '1,0,0', '--spacing', '0.5', '--size', '20x10'),
                         'format=png&origin=1%2C2%2C3&normal=0%2C-1%2C0&up=1%2C0%2C0&spacing=0.5&size=20%2C10')
        for wrong in ([], ['--axis', 'w'], ['--axis', ''], ['--origin', '1,2,3'], ['--axis', 'x', '--origin', '1,2,3', '--normal', '1,0,0'],
                      ['--axis', 'x', '--format', 'exr'], ['--axis', 'x', '--index', '9' * 3000]):
            result = self.run_at('slice', '--volume', 'head', '--out', self.out, *wrong)
            self.assertEqual(result.returncode, 1 if '--index' in wrong else 2, wrong)
        Daemon.answers['GET', '/api/v1/volumes/head/slice'] = [problem(422, '?index=: 99 is outside [0, 9]')]
        result = self.run_at('slice', '--volume', 'head', '--axis', 'x', '--index', '99', '--out', self.out)
        self.assertIn('99 is outside', result.stderr.decode())

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
