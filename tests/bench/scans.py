#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Compares images of real scans with brute force, and measures how they change while the view turns.

  scans.py --bin DIR --scenes DIR --data DIR --out FILE.csv [--only NAME...] [--threads N]

Each scene is drawn with and without light by the default of the renderer, 256² and 512²:

- "march_db": PSNR [dB] of the 256² image to splat-march, which marches 4 × 4 rays per pixel through a cubic B-spline of the
  samples, in double precision. It draws the noise of the scan as if it were material.
- "means_db": PSNR to means of 4 × 4 rays per pixel of the renderer itself, with quality.level_of_detail off.
- "change": rms change when the view turns by 0.1 degrees, in changes of these means. 1 = as still as them; "point_change" is the
  same with one ray per pixel and no low-pass filter of the pixels.

Needs numpy."""
import argparse
import csv
import json
import os
import subprocess
import sys
import tempfile

import numpy as np

from exact import psnr, read_png

SIZES, RAYS, TURN = (256, 512), 4, 0.1
MARCHED = 256
COLUMNS = ['scene', 'shading', 'size', 'march_db', 'means_db', 'change', 'point_change']


def run(command):
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f'{command[0]} failed: {done.stderr.strip()[-300:]}')


def turned(camera, degrees):
    """The camera after a turn about the axis of `up` through its target."""
    axis = np.array(camera['up'], float) / np.linalg.norm(camera['up'])
    from_target = np.array(camera['position'], float) - camera['target']
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    moved = c * from_target + s * np.cross(axis, from_target) + (1 - c) * (axis @ from_target) * axis
    return {**camera, 'position': list(moved + camera['target'])}


class Scan:
    """Draws one scene in one kind of light."""

    def __init__(self, options, scene, shading, folder):
        self.options, self.scene, self.shading, self.folder = options, scene, shading, folder

    def write(self, turn, detail):
        scene = json.loads(json.dumps(self.scene))
        scene['view'] |= {'shading': {'mode': self.shading}, 'quality': {'level_of_detail': detail}, 'background': [0, 0, 0, 1]}
        scene['cameras'] = [turned(scene['cameras'][0], turn)] * 3  # splat-bench writes the third view
        scene['name'] = 'scan'
        path = os.path.join(self.folder, 'scene.json')
        with open(path, 'w', encoding='utf-8') as file:
            json.dump(scene, file)
        return path

    def draw(self, size, turn, detail):
        run([os.path.join(self.options.bin, 'splat-bench'), '--backend', 'cpu', '--threads', str(self.options.threads), '--size', str(size), '--views', '3',
             '--warm', '0', '--data', self.options.data, '--out', self.folder + '/', self.write(turn, detail)])
        return read_png(os.path.join(self.folder, 'scan.png'))[..., :3].astype(float)

    def mean(self, size, turn):
        return self.draw(size * RAYS, turn, 'off').reshape(size, RAYS, size, RAYS, 3).mean((1, 3))

    def march(self):
        out = os.path.join(self.folder, 'march')
        run([os.path.join(self.options.bin, 'splat-march'), '--out', out, '--data', self.options.data, '--size', str(MARCHED), '--rays', str(RAYS), '--steps', '4',
             '--threads', str(self.options.threads), self.write(0, 'off')])
        return np.clip(np.fromfile(out, '<f4').reshape(MARCHED, MARCHED, 3), 0, 1) * 255

    def judge(self, size):
        def change(frames):
            return np.sqrt(np.mean((frames[0] - frames[1]) ** 2))
        means = [self.mean(size, turn) for turn in (0, TURN)]
        drawn, points = ([self.draw(size, turn, detail) for turn in (0, TURN)] for detail in ('auto', 'off'))
        return [round(psnr(drawn[0], self.march()), 1) if size == MARCHED else '', round(psnr(drawn[0], means[0]), 1),
                round(change(drawn) / change(means), 2), round(change(points) / change(means), 2)]


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument('--bin', required=True, help='folder of splat-bench and splat-march')
    p.add_argument('--scenes', required=True, help='folder of scene files')
    p.add_argument('--data', required=True, help='folder of the volumes')
    p.add_argument('--out', required=True, help='the table')
    p.add_argument('--only', nargs='+', default=['engine', 'head', 'bonsai', 'aneurism'], help='names of scenes; default: %(default)s')
    p.add_argument('--threads', type=int, default=2)
    options = p.parse_args()
    with tempfile.TemporaryDirectory(prefix='splat-scans-') as folder, open(options.out, 'w', newline='', encoding='utf-8') as file:
        table = csv.writer(file, lineterminator='\n')
        table.writerow(COLUMNS)
        for name in options.only:
            with open(os.path.join(options.scenes, name + '.json'), encoding='utf-8') as scene_file:
                scene = json.load(scene_file)
            for shading in ('none', 'phong'):
                for size in SIZES:
                    row = [name, shading, size, *Scan(options, scene, shading, folder).judge(size)]
                    table.writerow(row)
                    print('  '.join(str(x) for x in row), flush=True)


if __name__ == '__main__':
    main()
