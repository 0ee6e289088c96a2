#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Compares methods with the exact image of analytic fields, which no method's own kernel defines.

  exact.py --bin DIR [--vtk-bench FILE] --out FILE.csv [--images DIR] [--sheet FILE.png] [--fields F...]
           [--samples S...] [--threads N]

A field is a formula. Its exact image is the volume rendering integral of the formula itself. It is computed for one ray per
pixel, through the pixel's centre, in steps of an eighth of a voxel. Every mode of splat-bench draws the field from 64³ samples.
VTK's ray caster draws the same samples, if VTK is installed. All use the same camera and transfer function. Prints one line per image: PSNR [dB] over the three channels of
8 bits, the distance over which the shell's edge rises from 10 to 90 % [px], and milliseconds per frame of the same run: the
median of VIEWS frames after WARM others, in turns of TURN degrees, with the same number of threads for all. Needs numpy, and
VTK for its own rows.

Each field is drawn unshaded and shaded, and the field "smooth" is a control: it changes so slowly that all methods must agree
with the exact image. The exact image is shaded as renderer/splat/shade.h says, with the gradient of the formula, by one white
light from the viewer. VTK's shading limits the comparison:

- Its automatic headlight has no ambient colour, so that the ambient factor of a volume has no effect: it is 0 for all.
- It takes the direction of view for highlights from the image's centre. The shaded camera is far away, with a field of view of
  two degrees, so that this hardly differs from the direction per pixel.
- It looks shades up per voxel, from directions in 16 bits, and interpolates them. This is part of the method, as are the central
  differences of the samples by which VTK and this renderer find normals. The exact image has neither.
- Where differences of samples vanish, VTK's voxels are black and this renderer's face the light. The formula has a direction even
  there. Inside of the phantom this matters: the exact image differs by 45 dB from either rule. In other fields it is over 60 dB.

Scans have noise, and often 8 bits. The shaded fields are drawn again from samples with Gaussian noise, whose standard deviation
is 1 or 3 % of the range, in 16 and in 8 bits, by the default of this renderer and by VTK. The exact image has no noise. They are
also drawn from every second slice alone, without a filter before: surfaces then have steps.

Narrow samples: each field is drawn at NARROW² px, where a sample is one pixel wide, and again after a turn of NARROW_TURN degrees.
The exact image is then the mean of 4 × 4 rays per pixel. "change" is the rms change from one image to the next, in thousandths of
the range; one row has that of the exact images.
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
FOV, FAR_FOV = 34.0, 2.0  # degrees; unshaded and shaded
VIEWS, WARM, TURN = 9, 2, 10  # both programs write the third view as the image
DARK = 1e-5  # light at which a ray ends; 8 bits are 400 times as coarse
GRADIENT_STEP = 1e-4  # voxels
SHADING = {'mode': 'phong', 'ambient': 0, 'diffuse': 0.7, 'specular': 0.3, 'exponent': 32,
           'lights': [{'direction': [0, 0, 1], 'space': 'camera', 'color': [1, 1, 1]}]}
COLUMNS = ['field', 'shading', 'samples', 'method', 'psnr_db', 'rise_px', 'exact_rise_px', 'ms', 'change']
CLEAN = '16 bits'
# Bits, standard deviation of the noise, slices from one to the next.
SAMPLE_KINDS = {CLEAN: (16, 0, 1), '8 bits': (8, 0, 1), '16 bits, noise 1 %': (16, 0.01, 1), '8 bits, noise 1 %': (8, 0.01, 1),
                '16 bits, noise 3 %': (16, 0.03, 1), '8 bits, noise 3 %': (8, 0.03, 1), 'every second slice': (16, 0, 2)}
NARROW, NARROW_RAYS, NARROW_TURN = 112, 4, 0.1
NARROW_KIND = '16 bits, 1 px wide'
SEED = 40
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
DEFAULT = 'sheets, per pixel'
SHOWN = ['exact', 'sheets, per voxel', 'sheets, per pixel', 'VTK, distance 1.0']
SHOWN_ROWS = [('tubes', 'none'), ('engine', 'none'), ('Marschner-Lobb', 'none'), ('tubes', 'phong'), ('engine', 'phong')]


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


def smooth(x, y, z):
    """A blob as large as the volume."""
    return 0.62 * np.exp(-((x - 30) / 34) ** 2 - ((y - 33) / 30) ** 2 - ((z - 32) / 34) ** 2)


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


FIELDS = {'Marschner-Lobb': marschner_lobb, 'tubes': tubes, 'shell': shell, 'phantom': phantom, 'engine': engine, 'smooth': smooth}


def classify(value):
    values = [p[0] for p in RAMP]
    color = [np.interp(value, values, [p[1][c] for p in RAMP]) for c in range(3)]
    return color, -np.log1p(-np.interp(value, values, [p[2] for p in RAMP]))


def camera(shading):
    """The eye and the vertical angle of the judged view. Both cameras see the volume's centre at the same size."""
    centre = np.full(3, CENTRE)
    if shading == 'none':
        return EYE, FOV
    return centre + (EYE - centre) * np.tan(np.radians(FOV / 2)) / np.tan(np.radians(FAR_FOV / 2)), FAR_FOV


def turned(eye, degrees):
    """The eye after a turn about the vertical axis through the centre."""
    c, n = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    x, y, z = eye - CENTRE
    return np.array([c * x + n * z, y, c * z - n * x]) + CENTRE


def rays(eye, fov, size):
    """Returns the direction of view, and the directions to the centres of size² pixels, row by row."""
    ahead = np.full(3, CENTRE) - eye
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, [0, 1, 0])
    right /= np.linalg.norm(right)
    down = np.cross(ahead, right)
    scale = size / 2 / np.tan(np.radians(fov / 2))
    x, y = np.meshgrid((np.arange(size) + 0.5 - size / 2) / scale, (np.arange(size) + 0.5 - size / 2) / scale)
    d = (ahead + x[..., None] * right + y[..., None] * down).reshape(-1, 3)
    return ahead, d / np.linalg.norm(d, axis=-1, keepdims=True)


def gradient(field, at):
    parts = []
    for axis in range(3):
        ends = [field(*(at[a] + (side * GRADIENT_STEP if a == axis else 0) for a in range(3))) for side in (-1, 1)]
        parts.append((ends[1] - ends[0]) / (2 * GRADIENT_STEP))
    return np.stack(parts, -1)


def shade(color, normal, ahead, d):
    """Blinn's model, two-sided, by a white light that shines along the direction of view. Differences below 1e-9 per voxel are the
    rounding of the formula: the voxel faces the light, without a highlight."""
    length = np.linalg.norm(normal, axis=-1)
    has_side = length > 1e-9
    normal = normal / np.where(has_side, length, 1)[:, None]
    half = ahead + d
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    diffuse = SHADING['diffuse'] * np.where(has_side, abs(normal @ ahead), 1)
    shine = SHADING['specular'] * np.where(has_side, abs((normal * half).sum(-1)) ** SHADING['exponent'], 0)
    return [c * (SHADING['ambient'] + diffuse) + shine for c in color]


def exact_image(field, shading, size=SIZE, turn=0.0, last=SAMPLES - 1):
    """turn: degrees; last: where the volume ends along the third axis."""
    eye, fov = camera(shading)
    eye = turned(eye, turn)
    ahead, d = rays(eye, fov, size)
    with np.errstate(divide='ignore'):
        near, far = (0 - eye) / d, (np.array([SAMPLES - 1, SAMPLES - 1, last]) - eye) / d
    begin, end = np.minimum(near, far).max(-1), np.maximum(near, far).min(-1)
    light, image = np.ones(len(d)), np.zeros((len(d), 3))
    length = np.maximum(end - begin, 0)
    count = int(np.ceil(length.max() * STEPS))
    for i in range(count):
        rest = np.flatnonzero((length > 0) & (light > DARK))
        along = begin[rest] + (i + 0.5) / count * length[rest]
        at = [eye[a] + along * d[rest, a] for a in range(3)]
        color, depth = classify(field(*at))
        seen = np.flatnonzero(depth > 0)
        rest, color = rest[seen], [c[seen] for c in color]
        if shading == 'phong':
            color = shade(color, gradient(field, [a[seen] for a in at]), ahead, d[rest])
        opacity = 1 - np.exp(-depth[seen] * length[rest] / count)
        for c in range(3):
            image[rest, c] += light[rest] * opacity * color[c]
        light[rest] *= 1 - opacity
    return np.round(np.clip(image, 0, 1) * 255).reshape(size, size, 3)


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


def write_volume(path, field, bits, noise, step):
    index = np.arange(SAMPLES, dtype=float)
    z, y, x = np.meshgrid(index[::step], index, index, indexing='ij')
    values = np.clip(field(x, y, z), 0, 1)
    if noise:
        values = np.clip(values + np.random.default_rng(SEED).normal(0, noise, values.shape), 0, 1)
    with open(path, 'wb') as file:
        file.write(f'NRRD0004\ntype: uint{bits}\ndimension: 3\nsizes: {SAMPLES} {SAMPLES} {len(z)}\nspacings: 1 1 {step}\n'
                   'endian: little\nencoding: raw\n\n'.encode())
        file.write(np.round(values * (2 ** bits - 1)).astype(f'<u{bits // 8}').tobytes())


def scene(name, shading, kind, change, size=SIZE, turn=0.0):
    bits, _, step = SAMPLE_KINDS.get(kind, SAMPLE_KINDS[CLEAN])
    points = [{'value': p[0] * (2 ** bits - 1), 'color': list(p[1]), 'opacity': p[2]} for p in RAMP]
    edge = [0.5 / SAMPLES, 0.5 / SAMPLES, 0.5 * step / SAMPLES]  # the volume of other renderers ends at its outermost samples
    view = {'size': [size, size], 'background': [0, 0, 0, 1], 'shading': SHADING if shading == 'phong' else {'mode': 'none'},
            'transfer_function': {'reference_length': 1.0, 'points': points, 'order': change.get('order', 'pre')},
            'filter': change.get('filter', {}), 'compositing': change.get('compositing', {}),
            'clip': {'box': [edge, [1 - e for e in edge]]}}
    eye, fov = camera(shading)
    cameras = [{'projection': 'perspective', 'fov_y': fov, 'position': list(turned(eye, TURN * (i - 2) + turn)), 'target': [CENTRE] * 3, 'up': [0, 1, 0]}
               for i in range(VIEWS)]
    return {'name': name, 'volume': name + '.nrrd', 'visible_voxels': 0, 'note': '', 'view': view, 'cameras': cameras}


def measure(command, folder):
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder)
    lines = [line for line in done.stdout.splitlines() if line.startswith('{')]
    if not lines:
        sys.exit(f'{command[0]} failed: {done.stderr.strip()[-300:]}')
    return json.loads(lines[-1])['median_ms']


class Drawing:
    """Draws a field with one kind of samples, by this renderer and by VTK, and writes the images and rows."""

    def __init__(self, options, folder, write):
        self.options, self.folder, self.write = options, folder, write
        self.name = self.shading = self.kind = None

    def open(self, name, shading, kind):
        self.name, self.shading, self.kind = name, shading, kind

    def save(self, method, image):
        if self.options.images:
            parts = [self.name.lower()] + ['shaded'] * (self.shading == 'phong') + [self.kind] * (self.kind != CLEAN) + [method]
            write_png(os.path.join(self.options.images, '-'.join(parts).replace(', ', '-').replace(' ', '-') + '.png'), image)

    def methods(self, all_of_them):
        vtk = [f'VTK, distance {distance}' for distance in ('1.0', '0.5')] if self.options.vtk_bench else []
        return (list(METHODS) if all_of_them else [DEFAULT]) + vtk

    def draw(self, method, size=SIZE, turn=0.0):
        """Returns an image, and milliseconds per frame."""
        stem, path = self.name.lower(), os.path.join(self.folder, 'scene.json')
        with open(path, 'w', encoding='utf-8') as file:
            json.dump(scene(stem, self.shading, self.kind, METHODS.get(method, {}), size, turn), file)
        common = ['--threads', str(self.options.threads), '--size', str(size), '--views', str(VIEWS), '--warm', str(WARM),
                  '--data', self.folder, '--out', self.folder + '/', path]
        if method in METHODS:
            command = [os.path.join(self.options.bin, 'splat-bench'), '--backend', 'cpu', *common]
        else:
            command = ['xvfb-run', '-a', '-s', '-screen 0 1280x1280x24', '/usr/bin/python3', self.options.vtk_bench, '--sample-distance',
                       method.split()[-1], *(['--shade'] if self.shading == 'phong' else []), *common]
        ms = measure(command, self.folder)
        return read_png(os.path.join(self.folder, stem + '.png')), ms

    def compare(self, exact):
        """Returns the images of one field by method."""
        wanted = rise(exact) if (self.name, self.shading) == ('shell', 'none') else ''
        images = {'exact': exact}
        if self.kind in (CLEAN, 'every second slice'):
            self.save('exact', exact)
        for method in self.methods(self.kind == CLEAN):
            images[method], ms = self.draw(method)
            self.save(method, images[method])
            self.write([self.name, self.shading, self.kind, method, round(psnr(images[method], exact), 1),
                        round(rise(images[method]), 2) if wanted else '', round(wanted, 2) if wanted else '', round(ms, 2), ''])
        return images

    def compare_narrow(self):
        """Of samples as narrow as pixels: the distance from means over the pixels' areas, and the change while the view turns."""
        def mean(turn):
            fine = exact_image(FIELDS[self.name], self.shading, NARROW * NARROW_RAYS, turn)
            return fine.reshape(NARROW, NARROW_RAYS, NARROW, NARROW_RAYS, 3).mean((1, 3))

        def change(pair):
            return round(1000 * np.sqrt(np.mean(((pair[0] - pair[1]) / 255) ** 2)), 2)
        exact = [np.round(mean(turn)) for turn in (0, NARROW_TURN)]  # 8 bits, as the drawn images
        self.save('exact', exact[0])
        self.write([self.name, self.shading, self.kind, 'exact', '', '', '', '', change(exact)])
        for method in self.methods(False):
            drawn = [self.draw(method, NARROW, turn) for turn in (0, NARROW_TURN)]
            images = [image.astype(float) for image, _ in drawn]
            self.save(method, images[0])
            self.write([self.name, self.shading, self.kind, method, round(psnr(images[0], exact[0]), 1), '', '', round(drawn[0][1], 2),
                        change(images)])


def write_sheet(path, images):
    """Rows: SHOWN_ROWS; columns: exact, and the methods of SHOWN that were measured."""
    rows = [np.concatenate([images[row][method] for method in SHOWN if method in images[row]], 1) for row in SHOWN_ROWS if row in images]
    write_png(path, np.concatenate(rows, 0))


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument('--bin', required=True, help='folder of splat-bench')
    p.add_argument('--vtk-bench', default='', help='script that measures VTK; "" = without')
    p.add_argument('--out', required=True, help='the table')
    p.add_argument('--images', default='', help='folder for the images; "" = none')
    p.add_argument('--sheet', default='', help='an image with some of them side by side; "" = none')
    p.add_argument('--fields', nargs='+', default=list(FIELDS), choices=list(FIELDS), help='fields to measure; default all')
    p.add_argument('--samples', nargs='+', default=[*SAMPLE_KINDS, NARROW_KIND], choices=[*SAMPLE_KINDS, NARROW_KIND],
                   help='kinds of samples; default all')
    p.add_argument('--threads', type=int, default=2)
    options = p.parse_args()
    if options.sheet and CLEAN not in options.samples:
        p.error(f'--sheet shows {CLEAN!r}, which --samples leaves out')
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
        drawing = Drawing(options, folder, write)
        for name in options.fields:
            for shading in ('none', 'phong'):
                exact = {}  # images by the last slice
                for kind in options.samples:
                    if shading == 'none' and kind not in (CLEAN, NARROW_KIND):
                        continue
                    values = SAMPLE_KINDS.get(kind, SAMPLE_KINDS[CLEAN])
                    drawing.open(name, shading, kind)
                    write_volume(os.path.join(folder, name.lower() + '.nrrd'), FIELDS[name], *values)
                    if kind == NARROW_KIND:
                        drawing.compare_narrow()
                        continue
                    last = SAMPLES - values[2]
                    if last not in exact:
                        exact[last] = exact_image(FIELDS[name], shading, last=last)
                    found = drawing.compare(exact[last])
                    if kind == CLEAN:
                        images[name, shading] = found
    if options.sheet:
        write_sheet(options.sheet, images)


if __name__ == '__main__':
    main()
