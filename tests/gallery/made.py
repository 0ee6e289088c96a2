# SPDX-License-Identifier: Apache-2.0
"""Writes the volumes and meshes that renderer/gallery/*.md name made:NAME."""
import json
import math
import os
import random
import struct


def checkerboard(x, y, z):
    """Squares of eight units."""
    return 255 if (x // 8 + y // 8) % 2 else 0


def zebra(x, y, z):
    """Stripes across the first axis that wave along the second."""
    return 255 if math.sin(2 * math.pi * (x / 40 + 0.35 * math.sin(2 * math.pi * y / 96))) > 0 else 0


def rings(x, y, z):
    """Thin rings around the middle of a cube of 96 units, inside a wide faint one."""
    r, h, value = math.hypot(x - 48, y - 48), z - 48, 0
    for radius, thick, top in ((6, 1, 255), (12, 1.3, 200), (34, 5, 130)):
        value += top * math.exp(-0.5 * ((r - radius) ** 2 + h * h) / thick ** 2)
    return min(round(value), 255)


def tissue():
    """Centres of cells in a slab of 96 x 96 x 40 units, at least 15 units apart."""
    chance, found = random.Random(7), []
    for _ in range(900):
        center = (chance.uniform(10, 86), chance.uniform(10, 86), chance.uniform(10, 30))
        if all(math.dist(center, other) > 15 for other in found):
            found.append(center)
    return found


CELLS = tissue()


def nuclei(x, y, z):
    """Balls in the middles of cells, of different brightness."""
    distance, i = min((math.dist((x, y, z), center), i) for i, center in enumerate(CELLS))
    return round((150 + 25 * (i % 5)) / (1 + math.exp(2 * (distance - 4.3))))


def membranes(x, y, z):
    """The walls between neighbouring cells, and around all of them."""
    near = sorted(math.dist((x, y, z), center) for center in CELLS)[:2]
    wall = (near[1] - near[0]) / 2 if near[0] < 10.5 else 9
    return round(200 * math.exp(-min(wall, abs(near[0] - 10.5)) ** 2 / 1.2))


def even(n, length):
    """Returns n evenly spaced positions from 0 to length."""
    return [length * i / (n - 1) for i in range(n)]


def graded(n, length):
    """Returns n positions from 0 to length, four times as fine in the middle as an even grid, coarser outside."""
    ends = [(2 * i / (n - 1) - 1) for i in range(n)]
    return [0.5 * length * (1 + 0.25 * t + 0.75 * t ** 3) for t in ends]


# name: positions of the samples along each axis, value there
SCALARS = {
    'checkerboard': ([even(498, 497), even(398, 397), [0]], checkerboard),
    'zebra': ([even(1024, 1023), even(256, 1020), [0, 1, 2]], zebra),
    'nuclei': ([even(96, 95), even(96, 95), even(40, 39)], nuclei),
    'membranes': ([even(96, 95), even(96, 95), even(40, 39)], membranes),
    'rings-even': ([even(48, 96), even(48, 96), even(48, 96)], rings),
    'rings-graded': ([graded(48, 96), graded(48, 96), graded(48, 96)], rings),
}

AEROGEL, STEP = (36, 24, 24), 2  # samples, and the distance between them
FIBRE = 1.6  # radius


def fibres():
    """Straight fibres through the aerogel: a point and a direction of length 1 each."""
    chance, found = random.Random(5), []
    for _ in range(14):
        along = [chance.gauss(0, 0.5), chance.gauss(0, 1), chance.gauss(0, 1)]
        length = math.hypot(*along)
        found.append(([chance.uniform(8, n * STEP - 8) for n in AEROGEL], [a / length for a in along]))
    return found


def airflow(position, around):
    """Velocity of air that flows along the first axis. Each fibre adds the potential flow around a cylinder and slows
    the air near it."""
    velocity, slow = [1.0, 0.0, 0.0], 1.0
    for point, along in around:
        offset = [p - q for p, q in zip(position, point)]
        there = sum(o * a for o, a in zip(offset, along))
        r = [o - there * a for o, a in zip(offset, along)]
        square = max(sum(c * c for c in r), FIBRE * FIBRE)
        across = [(k == 0) - along[0] * a for k, a in enumerate(along)]
        inwards = 2 * sum(u * c for u, c in zip(across, r)) / square
        velocity = [v + FIBRE * FIBRE / square * (u - inwards * c) for v, u, c in zip(velocity, across, r)]
        slow *= 1 - math.exp(-sum(c * c for c in r) / (3 * FIBRE * FIBRE))
    return [slow * v for v in velocity]


def write_samples(folder, name, sidecar, samples):
    with open(os.path.join(folder, name + '.raw'), 'wb') as f:
        f.write(samples)
    path = os.path.join(folder, name + '.json')
    with open(path, 'w', encoding='utf-8') as f:
        json.dump({**sidecar, 'file': name + '.raw'}, f)
    return path


def write_scalars(folder, name):
    axes, value = SCALARS[name]
    return write_samples(folder, name, {'dims': [len(axis) for axis in axes], 'type': 'uint8',
                                        'coordinates': [axis if len(axis) > 1 else None for axis in axes]},
                         bytes(value(x, y, z) for z in axes[2] for y in axes[1] for x in axes[0]))


def write_airflow(folder, name):
    around, (nx, ny, nz) = fibres(), AEROGEL
    numbers = [v for z in range(nz) for y in range(ny) for x in range(nx) for v in airflow((x * STEP, y * STEP, z * STEP), around)]
    return write_samples(folder, name, {'dims': AEROGEL, 'spacing': [STEP] * 3, 'type': 'float32', 'endian': 'little',
                                        'components': 3},
                         struct.pack(f'<{len(numbers)}f', *numbers))


CYLINDER = 10  # radius


def write_wake(folder, name):
    """Air that flows along x past a turning cylinder, without friction, on a curvilinear grid around it: cells are small at
    the cylinder and grow outwards."""
    radii, angles, heights = 60, 161, 4
    points, vectors = [], []
    for k in range(heights):
        for j in range(angles):
            for i in range(radii):
                r, a = CYLINDER * 5 ** (i / (radii - 1)), 2 * math.pi * j / (angles - 1)
                outwards = (1 - (CYLINDER / r) ** 2) * math.cos(a)
                around = -(1 + (CYLINDER / r) ** 2) * math.sin(a) - 1.2 * CYLINDER / r
                c, s = math.cos(a), math.sin(a)
                points += [r * c, r * s, 3 * k - 4.5]
                vectors += [outwards * c - around * s, outwards * s + around * c, 0]
    path = os.path.join(folder, name + '.vtk')
    with open(path, 'wb') as f:
        f.write(f'# vtk DataFile Version 3.0\n{name}\nBINARY\nDATASET STRUCTURED_GRID\nDIMENSIONS {radii} {angles} {heights}\n'
                f'POINTS {len(points) // 3} float\n'.encode() + struct.pack(f'>{len(points)}f', *points)
                + f'\nPOINT_DATA {len(points) // 3}\nVECTORS velocity float\n'.encode() + struct.pack(f'>{len(vectors)}f', *vectors))
    return path


def write_cylinder(folder, name):
    grey = (0.6, 0.62, 0.66)
    ends = [(-9, 0, grey), (-9, CYLINDER, grey), (9, CYLINDER, grey), (9, 0, grey)]
    return write_obj(folder, name, [([0, 0, 0], [0, 0, 1], ends)], 96)


def write_obj(folder, name, profiles, sides=24):
    """A mesh of parts that are round about an axis: (point, direction of length 1, [(place along it, radius, colour)])."""
    vertices, faces = [], []
    for point, along, rings_of in profiles:
        least = min(range(3), key=lambda k: abs(along[k]))
        u = cross(along, [k == least for k in range(3)])
        length = math.hypot(*u)
        u = [c / length for c in u]
        v = cross(along, u)
        for ring, (place, radius, colour) in enumerate(rings_of):
            first = len(vertices) + 1
            for i in range(sides):
                c, s = radius * math.cos(2 * math.pi * i / sides), radius * math.sin(2 * math.pi * i / sides)
                where = [p + place * a + c * x + s * y for p, a, x, y in zip(point, along, u, v)]
                vertices.append((*where, *colour))
                if ring:
                    here, beside = first + i, first + (i + 1) % sides
                    faces += [(here - sides, beside - sides, beside), (here - sides, beside, here)]
    path = os.path.join(folder, name + '.obj')
    with open(path, 'w', encoding='utf-8') as f:
        f.writelines('v ' + ' '.join(f'{c:.5g}' for c in vertex) + '\n' for vertex in vertices)
        f.writelines(f'f {a} {b} {c}\n' for a, b, c in faces)
    return path


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def write_fibres(folder, name):
    grey = (0.75, 0.72, 0.65)
    return write_obj(folder, name, [(point, along, [(-60, FIBRE, grey), (60, FIBRE, grey)]) for point, along in fibres()], 12)


def write_needle(folder, name):
    """A needle with a handle; its tip is at the origin and it points along -z [mm]."""
    steel, blue = (0.8, 0.83, 0.88), (0.1, 0.3, 0.7)
    profile = [(0, 0, steel), (6, 1.5, steel), (110, 1.5, steel), (110, 4, blue), (114, 6, blue), (150, 6, blue),
               (154, 4, blue), (154, 0, blue)]
    return write_obj(folder, name, [([0, 0, 0], [0, 0, 1], profile)])


def write_station(folder, name):
    """A weather station on round ground, for demo:tornado: a mast, an arm with two cups, and a vane."""
    earth, steel, red = (0.36, 0.33, 0.25), (0.75, 0.78, 0.82), (0.8, 0.15, 0.1)
    foot = [2, 34, 0]
    parts = [([48, 48, -1.5], [0, 0, 1], [(0, 0, earth), (0, 58, earth), (1.5, 56, earth), (1.5, 0, earth)]),
             (foot, [0, 0, 1], [(0, 3, steel), (2, 3, steel), (2, 0.8, steel), (44, 0.6, steel), (44, 0, steel)])]
    for side in (-1, 1):
        along = [0.8 * side, -0.6 * side, 0]
        cup = [2 + 9 * along[0], 34 + 9 * along[1], 42]
        parts.append(([2, 34, 42], along, [(0, 0.5, steel), (9, 0.5, steel)]))
        parts.append((cup, [0.6 * side, 0.8 * side, 0], [(-3, 0, red), (-2.2, 1.8, red), (-0.8, 2.8, red), (1, 3, red), (1, 0, red)]))
    parts.append(([2, 34, 48], [0, 0, -1], [(-3, 0, red), (-1, 1.4, red), (1, 1.4, red), (4, 0.5, steel)]))
    return write_obj(folder, name, parts, 48)


WRITERS = {'airflow': write_airflow, 'cylinder': write_cylinder, 'fibres': write_fibres, 'needle': write_needle, 'station': write_station,
           'wake': write_wake, **dict.fromkeys(SCALARS, write_scalars)}


def write(folder, name):
    """Writes a volume or mesh below the folder; returns its path."""
    return WRITERS[name](folder, name)
