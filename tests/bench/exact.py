#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Compares methods with the exact image of analytic fields, which no method's own kernel defines.

  exact.py --bin DIR [--vtk-bench FILE] --out FILE.csv [--images DIR] [--sheet FILE.png] [--threads N]

A field is a formula on 64³ samples. Its exact image is the volume rendering integral of the formula itself along the ray of
each pixel's centre, in steps of an eighth of a voxel. The same samples, camera and transfer function go to every mode of
splat-bench and, where it is installed, to VTK's ray caster. Prints one line per image: PSNR [dB] over the three channels of
8 bits, the distance over which the shell's edge rises from 10 to 90 % [px], and milliseconds per frame of the same run.
Needs numpy, and VTK for its own rows.
"""
import argparse
import csv
import json
import os
import struct
import subprocess
import sys
import tempfile
import zlib

import numpy as np

SAMPLES, SIZE, STEPS = 64, 256, 8
CENTRE = (SAMPLES - 1) / 2
EYE = np.array([-70.0, -38.0, -98.0])
FOV = 34.0
COLUMNS = ['field', 'method', 'psnr_db', 'rise_px', 'exact_rise_px', 'ms']
RAMP = [(0.0, (0.2, 0.9, 0.9), 0.0), (0.3, (0.2, 0.9, 0.9), 0.0), (0.45, (0.9, 0.6, 0.3), 0.25), (0.6, (1.0, 0.9, 0.6), 0.45),
        (1.0, (1.0, 1.0, 1.0), 0.6)]

# What is changed in the view, by the name of the method.
METHODS = {
    'sheets, per voxel': {},
    'sheets, per voxel, cubic': {'filter': {'mode': 'ewa', 'kernel': 'cubic', 'lowpass': 0}},
    'slabs, per voxel': {'compositing': {'mode': 'slab', 'slab': 0.5}},
    'slabs, per pixel': {'compositing': {'mode': 'slab', 'slab': 0.5}, 'order': 'post'},
    'sheets, per pixel': {'order': 'post'},
}
SHOWN = ['exact', 'sheets, per voxel', 'sheets, per pixel', 'VTK, distance 1.0']
SHOWN_FIELDS = ['tubes', 'engine', 'Marschner-Lobb']


def marschner_lobb(x, y, z):
    x, y, z = (x - CENTRE) / CENTRE, (y - CENTRE) / CENTRE, (z - CENTRE) / CENTRE
    ring = np.cos(12 * np.pi * np.cos(np.pi * np.sqrt(x * x + y * y) / 2))
    return (1 - np.sin(np.pi * z / 2) + 0.25 * (1 + ring)) / 2.5


def tubes(x, y, z):
    """Six thin tubes with radii of 1.2 to 3 voxels."""
    value = np.zeros_like(x)
    for a, b, radius in [((8, 10, 12), (56, 50, 40), 1.2), ((50, 8, 20), (10, 56, 50), 1.6), ((10, 40, 8), (54, 20, 56), 2),
                         ((32, 6, 50), (30, 58, 10), 2.5), ((8, 30, 32), (56, 34, 30), 3), ((20, 12, 54), (44, 54, 12), 1.4)]:
        along = np.subtract(b, a).astype(float)
        p = (x - a[0], y - a[1], z - a[2])
        t = np.clip(sum(p[i] * along[i] for i in range(3)) / (along @ along), 0, 1)
        square = sum((p[i] - t * along[i]) ** 2 for i in range(3))
        value = np.maximum(value, np.exp(-square / radius ** 2))
    return value


def shell(x, y, z):
    """A spherical shell, five voxels thick."""
    r = np.sqrt((x - CENTRE) ** 2 + (y - CENTRE) ** 2 + (z - CENTRE) ** 2)
    return np.exp(-((r - 22) / 2.5) ** 2)


def step(distance):
    """1 inside of a surface and 0 outside, over about two voxels."""
    return 1 / (1 + np.exp(np.clip(distance / 0.45, -60, 60)))


def phantom(x, y, z):
    """Ellipsoids of different values inside each other."""
    def ball(cx, cy, cz, rx, ry, rz):
        r = np.sqrt(((x - cx) / rx) ** 2 + ((y - cy) / ry) ** 2 + ((z - cz) / rz) ** 2)
        return step((r - 1) * min(rx, ry, rz))
    value = 0.45 * ball(31.5, 31.5, 31.5, 27, 22, 24)
    value += 0.3 * ball(24, 28, 27, 7, 9, 6) + 0.5 * ball(40, 34, 30, 5, 6, 10) - 0.25 * ball(32, 36, 40, 9, 4, 5)
    return value


def engine(x, y, z):
    """A block with bores: constructive solid geometry."""
    def cylinder(u, v, cu, cv, radius):
        return np.sqrt((u - cu) ** 2 + (v - cv) ** 2) - radius
    block = np.maximum(np.maximum(abs(x - CENTRE) - 24, abs(y - CENTRE) - 16), abs(z - CENTRE) - 20)
    solid = block
    for cu in (20, 43):
        solid = np.maximum(solid, -cylinder(x, z, cu, CENTRE, 7))
    solid = np.maximum(solid, -cylinder(y, z, CENTRE, 22, 4))
    return 0.75 * step(solid)


FIELDS = {'Marschner-Lobb': marschner_lobb, 'tubes': tubes, 'shell': shell, 'phantom': phantom, 'engine': engine}


def classify(value):
    values = [p[0] for p in RAMP]
    color = [np.interp(value, values, [p[1][c] for p in RAMP]) for c in range(3)]
    return color, -np.log1p(-np.interp(value, values, [p[2] for p in RAMP]))


def rays():
    """Origins and directions of the pixels' centres."""
    ahead = np.full(3, CENTRE) - EYE
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, [0, 1, 0])
    right /= np.linalg.norm(right)
    down = np.cross(ahead, right)
    scale = SIZE / 2 / np.tan(np.radians(FOV / 2))
    x, y = np.meshgrid((np.arange(SIZE) + 0.5 - SIZE / 2) / scale, (np.arange(SIZE) + 0.5 - SIZE / 2) / scale)
    d = ahead + x[..., None] * right + y[..., None] * down
    return d / np.linalg.norm(d, axis=-1, keepdims=True)


def exact_image(field):
    d = rays()
    with np.errstate(divide='ignore'):
        near, far = (0 - EYE) / d, (SAMPLES - 1 - EYE) / d
    begin, end = np.minimum(near, far).max(-1), np.maximum(near, far).min(-1)
    light, image = np.ones((SIZE, SIZE)), np.zeros((SIZE, SIZE, 3))
    length = np.maximum(end - begin, 0)
    count = int(np.ceil(length.max() * STEPS))
    for i in range(count):
        at = begin + (i + 0.5) / count * length
        color, depth = classify(field(*(EYE[a] + at * d[..., a] for a in range(3))))
        opacity = 1 - np.exp(-depth * length / count)
        for c in range(3):
            image[..., c] += light * opacity * color[c]
        light *= 1 - opacity
    return np.round(np.clip(image, 0, 1) * 255)


def chunks(data):
    at = 8
    while at < len(data):
        size, = struct.unpack('>I', data[at:at + 4])
        yield data[at + 4:at + 8], data[at + 8:at + 8 + size]
        at += size + 12


def read_png(path):
    """An 8-bit image, RGB or RGBA, without interlacing, as an array of RGB."""
    with open(path, 'rb') as file:
        parts = list(chunks(file.read()))
    width, height, depth, kind = struct.unpack('>IIBB', parts[0][1][:10])
    channels = {2: 3, 6: 4}[kind]
    assert depth == 8
    raw = np.frombuffer(zlib.decompress(b''.join(body for name, body in parts if name == b'IDAT')), np.uint8)
    raw = raw.reshape(height, 1 + width * channels)
    image = np.zeros((height, width * channels), np.uint8)
    for y in range(height):
        image[y] = unfilter(raw[y, 0], raw[y, 1:], image[y - 1] if y else np.zeros_like(image[0]), channels)
    return image.reshape(height, width, channels)[..., :3].astype(float)


def unfilter(kind, row, above, channels):
    if kind == 0:
        return row
    if kind == 2:
        return row + above
    out = np.zeros(len(row) + channels, np.uint8)
    up = np.concatenate([np.zeros(channels, np.uint8), above])
    for i in range(channels, len(out)):
        a, b, c = int(out[i - channels]), int(up[i]), int(up[i - channels])
        if kind == 1:
            guess = a
        elif kind == 3:
            guess = (a + b) // 2
        else:
            guess = min((abs(b - c), 0, a), (abs(a - c), 1, b), (abs(a + b - 2 * c), 2, c))[2]
        out[i] = (int(row[i - channels]) + guess) & 255
    return out[channels:]


def write_png(path, image):
    rows = np.concatenate([np.zeros((len(image), 1), np.uint8), image.astype(np.uint8).reshape(len(image), -1)], 1).tobytes()
    parts = [(b'IHDR', struct.pack('>IIBBBBB', image.shape[1], image.shape[0], 8, 2, 0, 0, 0)), (b'IDAT', zlib.compress(rows)), (b'IEND', b'')]
    with open(path, 'wb') as file:
        file.write(b'\x89PNG\r\n\x1a\n')
        for name, body in parts:
            file.write(struct.pack('>I', len(body)) + name + body + struct.pack('>I', zlib.crc32(name + body)))


def psnr(image, exact):
    error = np.mean(((image - exact) / 255) ** 2)
    return 10 * np.log10(1 / error) if error else np.inf


def rise(image):
    """Mean distance over which brightness rises from 10 to 90 % of its first peak, from outside to the image's centre, in 32
    directions [px]. Made for the shell."""
    distances = []
    brightness = image.sum(-1)
    for angle in np.arange(32) * np.pi / 16:
        r = np.arange(0.75 * SIZE / 2, 0, -0.05)
        x, y = SIZE / 2 - 0.5 + r * np.cos(angle), SIZE / 2 - 0.5 + r * np.sin(angle)
        x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
        fx, fy = x - x0, y - y0
        line = ((1 - fy) * ((1 - fx) * brightness[y0, x0] + fx * brightness[y0, x0 + 1])
                + fy * ((1 - fx) * brightness[y0 + 1, x0] + fx * brightness[y0 + 1, x0 + 1]))
        peak = line.max()
        first, last = np.argmax(line > 0.1 * peak), np.argmax(line > 0.9 * peak)
        distances.append(0.05 * (last - first))
    return float(np.mean(distances))


def write_volume(path, field):
    index = np.arange(SAMPLES, dtype=float)
    z, y, x = np.meshgrid(index, index, index, indexing='ij')
    values = np.round(np.clip(field(x, y, z), 0, 1) * 65535).astype('<u2')
    with open(path, 'wb') as file:
        file.write(f'NRRD0004\ntype: uint16\ndimension: 3\nsizes: {SAMPLES} {SAMPLES} {SAMPLES}\nspacings: 1 1 1\n'
                   'endian: little\nencoding: raw\n\n'.encode())
        file.write(values.tobytes())


def scene(name, change):
    points = [{'value': p[0] * 65535, 'color': list(p[1]), 'opacity': p[2]} for p in RAMP]
    edge = 0.5 / SAMPLES  # the volume of other renderers ends at its outermost samples
    view = {'size': [SIZE, SIZE], 'background': [0, 0, 0, 1], 'shading': {'mode': 'none'},
            'transfer_function': {'reference_length': 1.0, 'points': points, 'order': change.get('order', 'pre')},
            'filter': change.get('filter', {}), 'compositing': change.get('compositing', {}),
            'clip': {'box': [[edge] * 3, [1 - edge] * 3]}}
    camera = {'projection': 'perspective', 'fov_y': FOV, 'position': list(EYE), 'target': [CENTRE] * 3, 'up': [0, 1, 0]}
    return {'name': name, 'volume': name + '.nrrd', 'visible_voxels': 0, 'note': '', 'view': view, 'cameras': [camera] * 3}


def measure(command, folder):
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder)
    lines = [line for line in done.stdout.splitlines() if line.startswith('{')]
    if not lines:
        sys.exit(f'{command[0]} failed: {done.stderr.strip()[-300:]}')
    return json.loads(lines[-1])['median_ms']


def compare(options, name, folder, write):
    field = FIELDS[name]
    exact = exact_image(field)
    stem = name.lower()
    write_volume(os.path.join(folder, stem + '.nrrd'), field)
    wanted = rise(exact) if name == 'shell' else ''
    images = {'exact': exact}

    def record(method, command):
        ms = measure(command, folder)
        images[method] = image = read_png(os.path.join(folder, stem + '.png'))
        if options.images:
            write_png(os.path.join(options.images, f'{stem}-{method.replace(", ", "-").replace(" ", "-")}.png'), image)
        write([name, method, round(psnr(image, exact), 1), round(rise(image), 2) if wanted else '', round(wanted, 2) if wanted else '',
               round(ms, 2)])

    if options.images:
        write_png(os.path.join(options.images, stem + '-exact.png'), exact)
    path = os.path.join(folder, 'scene.json')
    for method, change in METHODS.items():
        with open(path, 'w', encoding='utf-8') as file:
            json.dump(scene(stem, change), file)
        record(method, [os.path.join(options.bin, 'splat-bench'), '--backend', 'cpu', '--threads', str(options.threads), '--size', str(SIZE),
                        '--views', '3', '--data', folder, '--out', folder + '/', path])
    for distance in ('1.0', '0.5') if options.vtk_bench else ():
        record(f'VTK, distance {distance}',
               ['xvfb-run', '-a', '-s', '-screen 0 1280x1280x24', '/usr/bin/python3', options.vtk_bench, '--data', folder, '--size', str(SIZE),
                '--threads', str(options.threads), '--sample-distance', distance, '--views', '3', '--out', folder + '/', path])
    return images


def write_sheet(path, images):
    """Rows of fields; columns: exact, and the methods of SHOWN that were measured."""
    rows = [np.concatenate([images[field][method] for method in SHOWN if method in images[field]], 1) for field in SHOWN_FIELDS]
    write_png(path, np.concatenate(rows, 0))


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument('--bin', required=True, help='folder of splat-bench')
    p.add_argument('--vtk-bench', default='', help='script that measures VTK; "" = without')
    p.add_argument('--out', required=True, help='the table')
    p.add_argument('--images', default='', help='folder for the images; "" = none')
    p.add_argument('--sheet', default='', help='an image with some of them side by side; "" = none')
    p.add_argument('--threads', type=int, default=2)
    options = p.parse_args()
    options.bin = os.path.abspath(options.bin)
    options.vtk_bench = options.vtk_bench and os.path.abspath(options.vtk_bench)
    if options.images:
        os.makedirs(options.images, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix='splat-exact-') as folder, open(options.out, 'w', newline='', encoding='utf-8') as file:
        table = csv.writer(file, lineterminator='\n')
        table.writerow(COLUMNS)

        images = {}

        def write(row):
            table.writerow(row)
            print('  '.join(str(x) for x in row), flush=True)
        for name in FIELDS:
            images[name] = compare(options, name, folder, write)
    if options.sheet:
        write_sheet(options.sheet, images)


if __name__ == '__main__':
    main()
