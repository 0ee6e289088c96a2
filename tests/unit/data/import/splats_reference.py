# SPDX-License-Identifier: Apache-2.0
"""Reads a file of Gaussians and compares it with what the importer made of it.

    splats_reference.py FILE DUMP

DUMP has float32: positions [n][3], factors [n][6], opacities [n], harmonics [n][(degree + 1)²][3]. This reader shares no code
with the importer: it follows the published formats, and compares variances L·Lᵀ with R·S·Sᵀ·Rᵀ, not the factors.
"""
import array
import gzip
import math
import struct
import sys

TYPES = {'char': 'b', 'uchar': 'B', 'short': 'h', 'ushort': 'H', 'int': 'i', 'uint': 'I', 'float': 'f', 'double': 'd'}
CONSTANT = 0.5 * math.sqrt(1 / math.pi)


def read_ply(path):
    """Returns {element: [{property: value}]} of a little-endian file without lists."""
    with open(path, 'rb') as file:
        data = file.read()
    end = data.index(b'end_header\n') + len(b'end_header\n')
    elements = []
    for line in data[:end].decode().splitlines():
        words = line.split()
        if words[0] == 'format':
            assert words[1] == 'binary_little_endian'
        elif words[0] == 'element':
            elements.append((words[1], int(words[2]), []))
        elif words[0] == 'property':
            elements[-1][2].append((words[2], TYPES[words[1]]))
    out = {}
    for name, count, properties in elements:
        row = struct.Struct('<' + ''.join(kind for _, kind in properties))
        names = [property for property, _ in properties]
        out[name] = [dict(zip(names, row.unpack_from(data, end + i * row.size))) for i in range(count)]
        end += count * row.size
    assert end <= len(data)  # pc_short_100.ply is the beginning of a larger file
    return out


def trained(row):
    rest = sum(name.startswith('f_rest_') for name in row) // 3
    harmonics = [[row[f'f_dc_{c}'] for c in range(3)]]
    harmonics += [[row[f'f_rest_{c * rest + k}'] for c in range(3)] for k in range(rest)]
    return ([row['x'], row['y'], row['z']], [math.exp(row[f'scale_{a}']) for a in range(3)],
            [row[f'rot_{a}'] for a in range(4)], 1 / (1 + math.exp(-row['opacity'])), harmonics)


def bits(value, *counts):
    """Splits 32 bits into fractions, the highest bits first."""
    out, left = [], 32
    for count in counts:
        left -= count
        out.append((value >> left & (1 << count) - 1) / ((1 << count) - 1))
    return out


def mix(low, high, t):
    return low + (high - low) * t


def compressed(chunk, row, sh):
    axes = 'xyz'
    place = bits(row['packed_position'], 11, 10, 11)
    scale = bits(row['packed_scale'], 11, 10, 11)
    color = bits(row['packed_color'], 8, 8, 8, 8)
    position = [mix(chunk[f'min_{a}'], chunk[f'max_{a}'], t) for a, t in zip(axes, place)]
    scales = [math.exp(mix(chunk[f'min_scale_{a}'], chunk[f'max_scale_{a}'], t)) for a, t in zip(axes, scale)]
    _, *small = bits(row['packed_rotation'], 2, 10, 10, 10)
    rotation = [(t - 0.5) * math.sqrt(2) for t in small]
    rotation.insert(row['packed_rotation'] >> 30, math.sqrt(max(0, 1 - sum(q * q for q in rotation))))
    rgb = [mix(chunk.get(f'min_{c}', 0), chunk.get(f'max_{c}', 1), t) for c, t in zip('rgb', color)]
    harmonics = [[(value - 0.5) / CONSTANT for value in rgb]]
    rest = len(sh) // 3
    harmonics += [[sh[f'f_rest_{c * rest + k}'] * 8 / 255 - 4 for c in range(3)] for k in range(rest)]
    return position, scales, rotation, color[3], harmonics


def read_spz(path):
    """The format of nianticlabs/spz: arrays of one property after the other."""
    with gzip.open(path) as file:
        data = file.read()
    _, version, n, degree, fraction, _, _ = struct.unpack_from('<3I4B', data)
    rest, at = (degree + 1) ** 2 - 1, 16

    def read(size):
        nonlocal at
        at += n * size
        return [data[at + (i - n) * size:at + (i - n + 1) * size] for i in range(n)]

    if version == 1:
        positions = [list(struct.unpack('<3e', p)) for p in read(6)]
    else:
        positions = [[int.from_bytes(p[k:k + 3], 'little', signed=True) / 2 ** fraction for k in (0, 3, 6)] for p in read(9)]
    opacities = [o[0] / 255 for o in read(1)]
    colors = [[(c / 255 - 0.5) / 0.15 for c in rgb] for rgb in read(3)]
    scales = [[math.exp(s / 16 - 10) for s in three] for three in read(3)]
    rotations = []
    for packed in read(3 if version < 3 else 4):
        if version < 3:
            xyz = [q / 127.5 - 1 for q in packed]
            rotation = xyz + [math.sqrt(max(0, 1 - sum(q * q for q in xyz)))]
        else:
            value = int.from_bytes(packed, 'little')
            small = []
            for k in (2, 1, 0):
                size = (value >> 10 * k & 511) / 511 / math.sqrt(2)
                small.append(-size if value >> 10 * k + 9 & 1 else size)
            rotation = list(small)
            rotation.insert(value >> 30, math.sqrt(max(0, 1 - sum(q * q for q in small))))
        rotations.append(rotation[3:] + rotation[:3])
    harmonics = [[rgb] + [[(sh[3 * k + c] - 128) / 128 for c in range(3)] for k in range(rest)]
                 for rgb, sh in zip(colors, read(3 * rest))]
    assert at == len(data)
    return list(zip(positions, scales, rotations, opacities, harmonics))


def read(path):
    if path.endswith('.spz'):
        return read_spz(path)
    ply = read_ply(path)
    if 'chunk' not in ply:
        return [trained(row) for row in ply['vertex']]
    sh = ply.get('sh', [{}] * len(ply['vertex']))
    return [compressed(ply['chunk'][i // 256], row, sh[i]) for i, row in enumerate(ply['vertex'])]


def variance(scales, rotation):
    length = math.sqrt(sum(q * q for q in rotation))
    w, x, y, z = (q / length for q in rotation)
    turn = [[w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z]]
    return [[sum(turn[i][k] * turn[j][k] * scales[k] ** 2 for k in range(3)) for j in range(3)] for i in range(3)]


def product(factor):
    a, b, c, d, e, f = factor
    lower = [[a, 0, 0], [b, c, 0], [d, e, f]]
    return [[sum(lower[i][k] * lower[j][k] for k in range(3)) for j in range(3)] for i in range(3)]


def compare(what, i, got, expected, tolerance):
    assert len(got) == len(expected)
    for a, b in zip(got, expected):
        if not abs(a - b) <= tolerance:
            sys.exit(f'Gaussian {i}: {what}: {got} instead of {expected}')


def main(path, dump):
    expected = read(path)
    n, count = len(expected), len(expected[0][4])
    floats = array.array('f')
    with open(dump, 'rb') as file:
        floats.frombytes(file.read())
    assert len(floats) == n * (3 + 6 + 1 + 3 * count), len(floats)
    factors, opacities, harmonics = 3 * n, 9 * n, 10 * n
    for i, (position, scales, rotation, opacity, colors) in enumerate(expected):
        size = max(1e-30, max(scales) ** 2)
        compare('position', i, floats[3 * i:3 * i + 3], position, 1e-6 * (1 + max(map(abs, position))))
        compare('opacity', i, [floats[opacities + i]], [opacity], 1e-6)
        at = harmonics + 3 * count * i
        compare('harmonics', i, floats[at:at + 3 * count], [c for rgb in colors for c in rgb], 1e-5)
        got = product(floats[factors + 6 * i:factors + 6 * i + 6])
        for a, b in zip(got, variance(scales, rotation)):
            compare('variance', i, [v / size for v in a], [v / size for v in b], 1e-6)
    print(f'{n} Gaussians, {count} harmonics each')


main(*sys.argv[1:])
