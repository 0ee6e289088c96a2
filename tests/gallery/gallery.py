#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Draws the images of the pages renderer/gallery/*.md and fills in their measured values.

  gallery.py --build build/release [--data DIR] [--only PREFIX]
  gallery.py --sheet FILE.png [--build build/release] [--data DIR] [--only PREFIX]
  gallery.py --check

The pages contain the input. The script draws the "images" of each ```json block with `splatctl render --local`.
A view is the block's "view" with the merge patch of the image. "volume", and the "id" of a layer, is a built-in volume
(demo:NAME), one that made.py writes (made:NAME), or a file of the data folder (data:NAME). If that file does not exist,
the image stays unchanged. "difference": [A, B, GAIN] makes an image of middle grey plus GAIN times B - A. Images whose
names begin with _ are only for differences and are not kept. A block with "sheet" makes one image of the default views of its
"volumes", in rows of "columns". --sheet makes such an image of all built-in volumes and of all volumes of the data folder whose
names begin with PREFIX; look at it after a change of the first views. Each ```console block names a test program; the script
replaces the block by the program's output. --check draws nothing: it compares the pages with the images beside them.
"""
import argparse
import json
import os
import re
import struct
import subprocess
import sys
import tempfile
import zlib

import made

HERE = os.path.dirname(os.path.abspath(__file__))
SIZE_MAX = 2000000
FOLDER = os.path.join(HERE, '..', '..', 'renderer', 'gallery')


def merge(base, patch):
    """RFC 7396."""
    if not isinstance(patch, dict):
        return patch
    result = dict(base) if isinstance(base, dict) else {}
    for key, value in patch.items():
        if value is None:
            result.pop(key, None)
        else:
            result[key] = merge(result.get(key), value)
    return result


def read_png(path):
    """Width, height, bytes per pixel and the rows of an 8-bit PNG without interlacing."""
    with open(path, 'rb') as f:
        data = f.read()
    at, packed = 8, b''
    while at < len(data):
        size, kind = struct.unpack('>I4s', data[at:at + 8])
        body = data[at + 8:at + 8 + size]
        if kind == b'IHDR':
            width, height, depth, colour, _, _, lace = struct.unpack('>IIBBBBB', body)
            assert depth == 8 and lace == 0, path
            bpp = {0: 1, 2: 3, 4: 2, 6: 4}[colour]
        elif kind == b'IDAT':
            packed += body
        at += size + 12
    raw, rows, last = zlib.decompress(packed), [], bytes(width * bpp)
    for y in range(height):
        kind, row = raw[y * (width * bpp + 1)], bytearray(raw[y * (width * bpp + 1) + 1:(y + 1) * (width * bpp + 1)])
        for x, v in enumerate(row):
            a, b, c = (row[x - bpp] if x >= bpp else 0), last[x], (last[x - bpp] if x >= bpp else 0)
            row[x] = (v + [0, a, b, (a + b) // 2, paeth(a, b, c)][kind]) & 255
        rows.append(row)
        last = row
    return width, height, bpp, rows


def paeth(a, b, c):
    """The predictor of PNG filter 4."""
    p = a + b - c
    return min((abs(p - a), 0, a), (abs(p - b), 1, b), (abs(p - c), 2, c))[2]


def write_png(path, width, height, rows):
    """Rows of RGB bytes."""
    def chunk(kind, body):
        return struct.pack('>I', len(body)) + kind + body + struct.pack('>I', zlib.crc32(kind + body))
    packed = zlib.compress(b''.join(b'\0' + bytes(row) for row in rows), 9)
    with open(path, 'wb') as f:
        f.write(b'\x89PNG\r\n\x1a\n' + chunk(b'IHDR', struct.pack('>IIBBBBB', width, height, 8, 2, 0, 0, 0)) +
                chunk(b'IDAT', packed) + chunk(b'IEND', b''))


def write_difference(path, a, b, gain):
    """128 + gain·(b - a) of two images of one size."""
    width, height, bpp, first = read_png(a)
    _, _, _, second = read_png(b)
    rows = [bytes(max(0, min(255, 128 + gain * (q[x * bpp + c] - p[x * bpp + c])))
                  for x in range(width) for c in range(3)) for p, q in zip(first, second)]
    write_png(path, width, height, rows)


def write_sheet(path, tiles, columns):
    """Tiles of one size in rows of `columns`, 2 px apart."""
    width, height, _, _ = read_png(tiles[0])
    lines = -(-len(tiles) // columns)
    wide, grey = columns * (width + 2) - 2, b'\x30\x30\x30'
    rows = [bytearray(grey * wide) for _ in range(lines * (height + 2) - 2)]
    for n, tile in enumerate(tiles):
        _, _, bpp, pixels = read_png(tile)
        left, top = n % columns * (width + 2) * 3, n // columns * (height + 2)
        for y, row in enumerate(pixels):
            rgb = row if bpp == 3 else b''.join(bytes(row[x:x + 3]) for x in range(0, len(row), bpp))
            rows[top + y][left:left + width * 3] = rgb
    write_png(path, wide, len(rows), rows)


DEMOS = 'phantom engine vessels marschner-lobb checkerboard hydrogen galaxy sparse turbulence noise tornado jet'.split()
SUFFIXES = ('.nrrd', '.nhdr', '.vti', '.vtk', '.vtr', '.tif', '.tiff', '.json')


def all_volumes(data):
    """The built-in volumes, and the files of the data folder that may be volumes."""
    found = [os.path.join(folder, name) for folder, _, names in os.walk(data) for name in names if name.endswith(SUFFIXES)]
    return [f'demo:{name}' for name in DEMOS] + sorted(path for path in found if f'{os.sep}broken{os.sep}' not in path)


class Gallery:
    def __init__(self, options, work):
        self.options, self.work, self.failed = options, work, 0

    def path(self, name):
        return os.path.join(self.work if name.startswith('_') else FOLDER, name)

    def volume(self, name):
        """Returns the volume for splatctl; None if a file of the data folder does not exist."""
        kind, rest = name.split(':', 1)
        if kind == 'made':
            return made.write(self.work, rest)
        if kind == 'data':
            for folder in ('', 'volumes', 'formats/vtk', 'formats/splats'):
                path = os.path.join(self.options.data, folder, rest)
                if os.path.isfile(path):
                    return path
            return None
        return name

    def draw_block(self, block):
        if 'images' in block:
            self.draw(block)
        elif 'sheet' in block and block['sheet'].startswith(self.options.only):
            volumes = [self.volume(name) for name in block['volumes']]
            if None in volumes:
                print(f'skipped: {block["sheet"]}: a volume of it is not in the data folder')
            else:
                self.draw_sheet(self.path(block['sheet']), volumes, block['columns'], block['size'])

    def draw(self, block):
        wanted = [name for name in block['images'] if name[0] != '_' and name.startswith(self.options.only)]
        if not wanted:
            return
        volume, base = self.volume(block['volume']), block.get('view', {})
        for name, patch in block['images'].items():
            path = self.path(name)
            if name[0] != '_' and name not in wanted:
                continue
            if volume is None:
                print(f'skipped: {name}: {block["volume"][5:]} is not in the data folder')
            elif 'difference' in patch:
                a, b, gain = patch['difference']
                write_difference(path, self.path(a), self.path(b), gain)
            else:
                view = merge(base, patch)
                named = [layer for layer in view.get('layers', []) if 'id' in layer]
                missing = [layer['id'][5:] for layer in named if self.volume(layer['id']) is None]
                if missing:
                    print(f'skipped: {name}: {missing[0]} is not in the data folder')
                    continue
                for layer in named:
                    layer['id'] = self.volume(layer['id'])
                self.render(volume, view, path)

    def draw_sheet(self, path, volumes, columns, size):
        tiles = []
        for n, volume in enumerate(volumes):
            tile = os.path.join(self.work, f'tile{n}.png')
            if self.render(volume, {'size': size}, tile, shown=volume):
                tiles.append(tile)
        if tiles:
            write_sheet(path, tiles, columns)
            print(f'{os.path.basename(path)}: {os.path.getsize(path)} bytes')

    def render(self, volume, view, path, shown=None):
        command = [os.path.join(self.options.build, 'bin', 'splatctl'), 'render', '--local', '--volume', volume,
                   '--view', '-', '--out', path]
        done = subprocess.run(command, input=json.dumps(view), text=True, capture_output=True, check=False)
        if done.returncode:
            self.failed += 1
            print(f'FAILED {shown or os.path.basename(path)}: {done.stderr.strip()}')
        else:
            print(shown or f'{os.path.basename(path)}: {os.path.getsize(path)} bytes')
        return done.returncode == 0

    def measure(self, program):
        """Returns the output of a test program, without the lines of skipped targets."""
        done = subprocess.run([os.path.join(self.options.build, 'tests', program)], text=True, capture_output=True,
                              check=False)
        self.failed += done.returncode != 0
        return ''.join(line + '\n' for line in done.stdout.splitlines() if not line.startswith('skipped'))


def read_pages():
    """Path → text of each page."""
    pages = {}
    for name in sorted(name for name in os.listdir(FOLDER) if name.endswith('.md')):
        with open(os.path.join(FOLDER, name), encoding='utf-8') as f:
            pages[os.path.join(FOLDER, name)] = f.read()
    return pages


def blocks(text):
    return [json.loads(body) for body in re.findall(r'```json\n(.*?)```', text, re.S)]


def check(pages):
    """Returns the differences between the images that the pages define, the images that the pages show, and the folder."""
    text = '\n'.join(pages.values())
    made = {name for block in blocks(text) for name in [*block.get('images', {}), block.get('sheet', '_')] if name[0] != '_'}
    shown = set(re.findall(r'\(([^()/]+\.(?:png|jpg))\)', text))
    there = {name for name in os.listdir(FOLDER) if not name.endswith('.md')}
    size = sum(os.path.getsize(os.path.join(FOLDER, name)) for name in there)
    findings = [f'{name}: defined in a block, but not shown on a page' for name in sorted(made - shown)]
    findings += [f'{name}: shown on a page, but not defined in a block' for name in sorted(shown - made)]
    findings += [f'{name}: defined in a block, but not in the folder' for name in sorted(made - there)]
    findings += [f'{name}: in the folder, but not defined in a block' for name in sorted(there - made)]
    findings += ['the output of a test on a page contains FAILED'] * ('FAILED' in text)
    findings += [f'the images have {size} bytes; the limit is {SIZE_MAX}'] * (size > SIZE_MAX)
    return findings


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--build', default='build/release')
    parser.add_argument('--data', default=os.path.join(HERE, '..', '..', '..', 'shared', 'data'))
    parser.add_argument('--only', default='', metavar='PREFIX', help='draw only images whose names begin with PREFIX; run no tests')
    parser.add_argument('--check', action='store_true', help='compare the pages with their folder of images; draw nothing')
    parser.add_argument('--sheet', metavar='FILE.png', help='make only an image of all default views')
    options = parser.parse_args()
    if options.sheet:
        with tempfile.TemporaryDirectory() as work:
            volumes = [v for v in all_volumes(options.data) if re.split('[/:]', v)[-1].startswith(options.only)]
            Gallery(options, work).draw_sheet(options.sheet, volumes, 6, [300, 250])
        return 0  # formats that cannot be read are named, and left out
    pages = read_pages()
    if options.check:
        findings = check(pages)
        print('\n'.join(findings) or 'the pages match their folder of images')
        return 1 if findings else 0
    with tempfile.TemporaryDirectory() as work:
        gallery = Gallery(options, work)
        for path, text in pages.items():
            for block in blocks(text):
                gallery.draw_block(block)
            if not options.only:
                text = re.sub(r'```console\n\$ (\S+)\n.*?```',
                              lambda m: f'```console\n$ {m[1]}\n{gallery.measure(m[1])}```', text, flags=re.S)
                with open(path, 'w', encoding='utf-8') as f:
                    f.write(text)
    return 1 if gallery.failed else 0


if __name__ == '__main__':
    sys.exit(main())
