#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Tests the command lines of splat-bench, splat-limit and splat-march: bench_test.py BENCH LIMIT MARCH. Asserts no times."""
import array
import json
import os
import subprocess
import sys
import tempfile
import unittest

PROGRAM, LIMIT, MARCH = sys.argv.pop(1), sys.argv.pop(1), sys.argv.pop(1)
KEYS = {'coarse', 'scene', 'backend', 'device', 'isa', 'threads', 'in_flight', 'size', 'mode', 'compositing', 'order', 'shading', 'lod', 'views',
        'splats', 'visible_voxels', 'fragments', 'median_ms', 'p95_ms', 'mean_ms', 'cpu_ms', 'fps', 'splats_per_second',
        'stages', 'rest_ms', 'cold_classify_ms', 'allocations', 'voxels', 'bytes', 'derived_bytes', 'derived_per_voxel', 'peak_rss'}


def run(*arguments):
    return subprocess.run([PROGRAM, *arguments], capture_output=True, text=True, timeout=240, check=False)


class CommandLine(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)

    def scene(self, file, **content):
        path = os.path.join(self.folder.name, file)
        with open(path, 'w', encoding='utf-8') as f:
            json.dump(content, f)
        return path

    def lines(self, done):
        self.assertEqual(done.returncode, 0, done.stderr)
        return [json.loads(line) for line in done.stdout.splitlines()]

    def test_one_line_per_scene_with_every_key(self):
        small = self.scene('small.json', name='small', volume='demo:hydrogen?size=24',
                           view={'size': [40, 30], 'shading': {'mode': 'none'}})
        absent = self.scene('absent.json', name='absent', volume='nowhere.nrrd')
        first, second = self.lines(run('--backend', 'cpu', '--order', 'pre', '--threads', '2', '--views', '3', '--warm', '1', '--size', '32', small,
                                       absent))
        self.assertEqual(set(first), KEYS)
        self.assertEqual((first['scene'], first['backend'], first['threads'], first['size'], first['views']),
                         ('small', 'cpu', 2, 32, 3))
        self.assertEqual((first['mode'], first['compositing'], first['shading']), ('adaptive', 'sheet', 'none'))
        self.assertEqual(first['order'], 'pre')
        self.assertLessEqual({'classify', 'splat', 'tile'}, set(first['stages']))
        self.assertGreater(first['visible_voxels'], 0)
        self.assertGreaterEqual(first['visible_voxels'], first['splats'])
        self.assertLessEqual(first['median_ms'], first['p95_ms'])
        self.assertGreater(first['splats_per_second'], 0)
        self.assertLessEqual(0, first['rest_ms'])
        self.assertLessEqual(first['rest_ms'], first['mean_ms'])
        self.assertEqual(first['voxels'], 24 ** 3)
        self.assertEqual(first['bytes'], 24 ** 3 + first['derived_bytes'])
        self.assertGreater(first['derived_bytes'], 0)
        self.assertAlmostEqual(first['derived_per_voxel'], first['derived_bytes'] / 24 ** 3, 4)
        self.assertEqual(second['scene'], 'absent')
        self.assertIn('nowhere.nrrd', second['skipped'])

    def test_software_gl_is_labelled(self):
        options = ('--volume', 'demo:phantom?size=16', '--order', 'pre', '--size', '32', '--views', '2', '--warm', '0')
        done = run('--backend', 'gl-software', *options)
        if done.returncode:
            self.assertIn('gl-software', done.stderr)
            self.skipTest('no software GL: ' + done.stderr)
        line, = self.lines(done)
        self.assertEqual(set(line), KEYS)
        self.assertEqual(line['backend'], 'gl-software')
        self.assertTrue(line['device'].endswith('software GL, for correctness only'), line['device'])
        self.assertEqual(set(line['stages']), {'classify', 'splat', 'bin', 'tile', 'resolve', 'read'})
        other, = self.lines(run('--backend', 'cpu', *options))
        self.assertEqual(line['visible_voxels'], other['visible_voxels'])
        self.assertGreater(line['splats'], 0)

    def test_edits_of_the_transfer_function(self):
        points = [{'value': v, 'color': [1, 1, 1], 'opacity': o} for v, o in ((0.195, 0), (0.35, 0.2), (0.9, 0.4))]
        path = self.scene('e.json', volume='demo:phantom?size=16', view={'transfer_function': {'points': points}})
        options = ('--order', 'pre', '--size', '16', '--views', '3', '--warm', '0', path)
        plain, colour, opacity, moved = (self.lines(run('--edit', edit, *options))[0]
                                         for edit in ('none', 'colour', 'opacity', 'range'))
        self.assertEqual(colour['visible_voxels'], plain['visible_voxels'])
        self.assertEqual(opacity['visible_voxels'], plain['visible_voxels'])
        self.assertLess(moved['visible_voxels'], plain['visible_voxels'])
        self.assertEqual(run('--edit', 'shape', path).returncode, 2)

    def test_cameras_and_overrides(self):
        cameras = [{'position': [0, 0, 100 + i], 'target': [0, 0, 0], 'up': [0, 1, 0]} for i in range(5)]
        path = self.scene('c.json', volume='demo:phantom?size=16', cameras=cameras)
        line, = self.lines(run('--mode', 'ewa', '--shading', 'phong', '--size', '16', '--warm', '0', path))
        self.assertEqual((line['views'], line['mode'], line['shading']), (5, 'ewa', 'phong'))
        coarser, = self.lines(run('--coarse', '1', '--mode', 'ewa', '--size', '16', '--warm', '0', path))
        self.assertEqual((line['coarse'], coarser['coarse']), (0, 1))
        self.assertLess(coarser['splats'], line['splats'])
        line, = self.lines(run('--views', '2', '--size', '16', '--backend', 'null', path))
        self.assertEqual((line['views'], line['backend']), (2, 'null'))

    def test_against_another_setting(self):
        options = ('--volume', 'demo:sparse?size=16', '--order', 'pre', '--size', '24', '--views', '3', '--warm', '1')
        same, = self.lines(run('--mode', 'ewa', '--against', 'mode=ewa', *options))
        self.assertEqual(same['against']['setting'], 'mode=ewa')
        self.assertEqual((same['against']['psnr_db'], same['against']['psnr_worst_db']), (999, 999))
        other, = self.lines(run('--mode', 'ewa', '--against', 'mode=none', *options))
        self.assertEqual(other['mode'], 'ewa')
        self.assertLess(other['against']['psnr_db'], 60)
        self.assertLessEqual(other['against']['psnr_worst_db'], other['against']['psnr_db'])
        self.assertEqual(other['against']['splats'], other['splats'])
        coarse, = self.lines(run('--coarse', '0', '--against', 'coarse=1', *options))
        self.assertLess(coarse['against']['splats'], coarse['splats'])
        # An edit changes the image, so only times are compared.
        edit, = self.lines(run('--edit', 'colour', '--against', 'edit=none', *options))
        self.assertNotIn('psnr_db', edit['against'])
        self.assertEqual(edit['visible_voxels'], same['visible_voxels'])
        self.assertNotIn('against', self.lines(run(*options))[0])
        for wrong in 'blur=1', 'mode', '=ewa', 'coarse=9', 'threads=1', 'compositingg=slab':
            self.assertEqual(run('--against', wrong, *options).returncode, 2, wrong)
        done = run('--against', 'mode=blurry', *options)
        self.assertEqual(done.returncode, 1)
        self.assertIn('/filter/mode', done.stderr)

    def test_level_of_detail(self):
        options = ('--volume', 'demo:phantom?size=16', '--size', '16', '--views', '1', '--warm', '0')
        for lod in 'auto', 'off':
            self.assertEqual(self.lines(run('--lod', lod, *options))[0]['lod'], lod)
        done = run('--lod', 'perhaps', *options)
        self.assertEqual(done.returncode, 1)
        self.assertIn('/quality/level_of_detail', done.stderr)

    def test_cancelled_frames_are_counted(self):
        # Whether the flag is set before the frame finishes is random; every trial ends in one of the two ways.
        line, = self.lines(run('--volume', 'demo:phantom?size=32', '--size', '64', '--views', '2', '--cold', '--cancel', '3'))
        cancel = line['cancel']
        self.assertEqual(set(cancel), {'stopped', 'finished', 'median_ms', 'worst_ms', 'range_ms'})
        self.assertTrue(cancel['stopped'] == 3 or cancel['stopped'] + cancel['finished'] == 12, cancel)
        self.assertLessEqual(cancel['median_ms'], cancel['worst_ms'])

    def test_allocations_are_counted(self):
        options = ('--volume', 'demo:phantom?size=32', '--size', '32', '--views', '4')
        cold, = self.lines(run('--cold', *options))
        self.assertGreater(cold['allocations'], 0)

    def test_the_steady_state_allocates_nothing(self):
        # An orbit is rendered once as warm-up; its cameras see the volume along more than one axis.
        options = ('--volume', 'demo:engine?size=48', '--size', '96', '--views', '24', '--warm', '24')
        for choice in ((), ('--shading', 'phong'), ('--compositing', 'slab'), ('--compositing', 'splat'), ('--isa', 'scalar'),
                       ('--size', '16'), ('--coarse', '1')):
            line, = self.lines(run(*options, *choice))
            self.assertEqual(line['allocations'], 0, choice)

    def test_saved_volumes_are_the_same(self):
        prefix = os.path.join(self.folder.name, 'kept-')
        options = ('--size', '16', '--views', '1', '--warm', '0')
        first, = self.lines(run('--volume', 'demo:sparse?size=24', '--save-volume', prefix, *options))
        path = prefix + 'demo-sparse-size=24.nrrd'
        again, = self.lines(run('--volume', path, *options))
        for key in 'voxels', 'visible_voxels', 'bytes':
            self.assertEqual(first[key], again[key], key)
        done = run('--volume', 'demo:galaxy?size=16', '--save-volume', prefix, *options)
        self.assertEqual(done.returncode, 1)
        self.assertIn('even grid', done.stderr)

    def test_out_writes_a_png(self):
        prefix = os.path.join(self.folder.name, 'look-')
        self.lines(run('--volume', 'demo:phantom?size=16', '--size', '16', '--views', '3', '--out', prefix))
        written = [n for n in os.listdir(self.folder.name) if n.startswith('look-')]
        self.assertEqual(len(written), 1)
        with open(os.path.join(self.folder.name, written[0]), 'rb') as f:
            self.assertEqual(f.read(8), b'\x89PNG\r\n\x1a\n')

    def test_errors_name_the_place(self):
        bad = self.scene('bad.json', volume='demo:phantom?size=16', view={'filter': {'mode': 'blurry'}})
        done = run(bad)
        self.assertEqual(done.returncode, 1)
        self.assertIn('/filter/mode', done.stderr)
        done = run('--compositing', 'heap', '--volume', 'demo:phantom?size=16')
        self.assertEqual(done.returncode, 1)
        self.assertIn('/compositing/mode', done.stderr)
        self.assertEqual(run(os.path.join(self.folder.name, 'none.json')).returncode, 1)
        self.assertEqual(run('--volume', 'demo:nothing').returncode, 1)

    def test_layers_name_volumes(self):
        options = ('--volume', 'demo:sparse?size=16', '--size', '16', '--views', '1', '--warm', '0', '--layers')
        line, = self.lines(run(*options, '[{"type": "volume"}, {"type": "gaussians", "id": "demo:gaussians?size=10"}]'))
        self.assertEqual(line['views'], 1)
        done = run(*options, '[{"type": "gaussians", "id": "nothing.ply"}]')
        self.assertEqual(done.returncode, 1)
        self.assertIn('nothing.ply: not below the folder of --data', done.stderr)

    def test_frames_in_flight(self):
        """The backend limits the frames in flight; the images are the same."""
        drawn = {}
        for backend, depth in ('cpu', 1), ('gl-software', 2):
            for wanted in 1, 2, 4:
                done = run('--volume', 'demo:phantom?size=16', '--size', '32', '--views', '3', '--backend', backend, '--in-flight', str(wanted))
                if backend != 'cpu' and done.returncode != 0:
                    self.skipTest('no software GL: ' + done.stderr)
                line, = self.lines(done)
                self.assertEqual(line['in_flight'], min(wanted, depth))
                self.assertEqual(drawn.setdefault(backend, line['splats']), line['splats'])

    def test_usage(self):
        for arguments in ([], ['--size', '0', 'x.json'], ['--threads', 'two', 'x.json'], ['--nonsense'], ['--cancel', '0', 'x.json'],
                          ['--in-flight', '5', 'x.json']):
            done = run(*arguments)
            self.assertEqual(done.returncode, 2, arguments)
            self.assertTrue(done.stderr)
        done = run('--help')
        self.assertEqual(done.returncode, 0)
        self.assertIn('--data DIR', done.stdout)
        self.assertEqual(run('--version').stdout.split()[0], 'splat-bench')

    def test_march_integrates_a_constant_field(self):
        with open(os.path.join(self.folder.name, 'even.nrrd'), 'wb') as f:
            f.write(b'NRRD0004\ntype: uint8\ndimension: 3\nsizes: 8 8 8\nspacings: 1 1 1\nencoding: raw\n\n' + bytes([200]) * 512)
        color, opacity = (1, 0.5, 0.25), 0.1
        points = [{'value': v, 'color': color, 'opacity': opacity} for v in (100, 250)]
        scene = self.scene('even.json', name='even', volume='even.nrrd',
                           view={'size': [12, 12], 'background': [0, 0, 0, 1], 'shading': {'mode': 'none'},
                                 'transfer_function': {'reference_length': 1, 'points': points}},
                           cameras=[{'projection': 'orthographic', 'position': [3.5, 3.5, -20], 'target': [3.5, 3.5, 3.5], 'up': [0, -1, 0], 'height': 6}])
        out = os.path.join(self.folder.name, 'even.f32')
        march = [MARCH, '--data', self.folder.name, '--rays', '2', '--out', out]
        done = subprocess.run([*march, scene], capture_output=True, text=True, timeout=60, check=False)
        self.assertEqual(done.returncode, 0, done.stderr)
        with open(out, 'rb') as f:
            image = array.array('f', f.read())
        self.assertEqual(len(image), 12 * 12 * 3)
        for i, value in enumerate(image):  # a ray of 8 voxels, which end half a cell beyond the outermost samples
            self.assertAlmostEqual(value, color[i % 3] * (1 - (1 - opacity) ** 8), 4)
        for arguments, status in (([*march, '--camera', '1', scene], 1), ([*march, '--rays', 'x', scene], 2), ([MARCH, scene], 2)):
            done = subprocess.run(arguments, capture_output=True, text=True, timeout=60, check=False)
            self.assertEqual(done.returncode, status, arguments)
            self.assertNotEqual(done.stderr, '')


class Limit(unittest.TestCase):
    def measure(self, *arguments):
        return subprocess.run([LIMIT, *arguments], capture_output=True, text=True, timeout=240, check=False)

    def test_every_rate_is_there(self):
        for threads in 1, 3:
            done = self.measure('--threads', str(threads), '--isa', 'scalar')
            self.assertEqual(done.returncode, 0, done.stderr)
            row = json.loads(done.stdout)
            self.assertEqual((row['isa'], row['threads']), ('scalar', threads))
            self.assertEqual(set(row['add']), {'3', '5', '7', '11'})
            for rate in (*row['add'].values(), row['set_up'], row['read'], row['copy']):
                self.assertGreater(rate, 0)

    def test_usage(self):
        for arguments in ['--threads', '0'], ['--threads', '999'], ['--threads', '2x'], ['--isa', 'abacus'], ['more'], ['--nonsense']:
            done = self.measure(*arguments)
            self.assertEqual(done.returncode, 2, arguments)
            self.assertTrue(done.stderr)
        self.assertEqual(self.measure('--help').returncode, 0)


if __name__ == '__main__':
    unittest.main()
