#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Tests of report.py on invented numbers (ratios, goals, the limit, missing files) and of run_all.py."""
import csv
import os
import re
import shutil
import subprocess
import sys
import tempfile
import types
import unittest
import xml.dom.minidom

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, HERE)
import gpu  # noqa: E402
import gpu_tables  # noqa: E402
import report  # noqa: E402
import run_all  # noqa: E402
import scene_tables  # noqa: E402
import tables  # noqa: E402

with open(os.path.join(HERE, 'serve.mjs'), encoding='utf-8') as script:
    SERVE_COLUMNS = re.findall(r"'(\w+)'", re.search(r'^const COLUMNS = \[(.*?)\];', script.read(), re.S | re.M)[1])


class Report(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)

    def write(self, name, columns, *rows):
        with open(os.path.join(self.folder.name, name), 'w', encoding='utf-8', newline='') as f:
            table = csv.DictWriter(f, columns, restval='')
            table.writeheader()
            table.writerows(rows)

    def scene(self, scene, renderer, fps, **more):
        row = {'scene': scene, 'renderer': renderer, 'size': 512, 'threads': 2, 'shading': 'none', 'fps': fps,
               'median_ms': 1000 / fps, 'p95_ms': 1100 / fps, 'splats': 500000, 'fragments': 12500000, 'voxels': 1000000,
               'derived_per_voxel': 0.5, 'allocations': 0}
        return {**row, **more}

    def line(self, text, start):
        found = [line for line in text.split('\n') if line.startswith(start)]
        self.assertEqual(len(found), 1, start)
        return [cell.strip() for cell in found[0].strip('|').split('|')]

    def make(self):
        done = subprocess.run([sys.executable, os.path.join(HERE, 'report.py'), self.folder.name], capture_output=True, text=True,
                              check=False)
        self.assertEqual(done.returncode, 0, done.stderr)
        return self.page('README'), done.stdout

    def page(self, name):
        with open(os.path.join(self.folder.name, name + '.md'), encoding='utf-8') as f:
            return f.read()

    def test_ratios_and_goals(self):
        self.write('scenes.csv', run_all.SCENE_COLUMNS, self.scene('engine', 'splatd', 99), self.scene('engine', 'vtk', 10),
                   self.scene('engine', 'scalar', 11), self.scene('head-full', 'splatd', 45), self.scene('head-full', 'vtk', 9),
                   self.scene('engine', 'splatd', 40, size=1024), self.scene('engine', 'vtk', 4, size=1024),
                   self.scene('engine', 'splatd', 50, shading='phong'), self.scene('noise', 'splatd', 0.5), self.scene('noise', 'vtk', 1))
        first, headline = self.make()
        text = self.page('speed')
        self.assertEqual(self.line(first, '| engine'), ['engine', '99 (9.9×)', '10×: **missed**', '–', '–'])
        self.assertEqual(self.line(first, '| [Speed per voxel')[1:], ['5.0 to 9.9 times VTK at 512², unshaded, on volumes with empty voxels', '3', '1: engine'])
        self.assertEqual(self.line(text, '| noise')[2:7], ['0.5 (0.5×)', '–', '–', '–', '–'])
        engine, head = self.line(text, '| engine'), self.line(text, '| head-full')
        self.assertEqual(engine[2:7], ['99 (9.9×)', '50', '40 (10.0×)', '–', '10×: **missed**'])
        self.assertEqual(engine[7], '30× Chen, 12× Botha')
        self.assertEqual(head[2], '45 (5.0×)')
        self.assertEqual(head[6], '5×: met, 40 fps: met')
        self.assertIn('0.5 to 9.9 times VTK', headline)
        self.assertIn('engine, 0.50 million splats: 99 frames per second, 9.9 times VTK', headline)
        xml.dom.minidom.parse(os.path.join(self.folder.name, 'scenes.svg'))

    def test_missing_measurements_are_left_out(self):
        self.write('scenes.csv', run_all.SCENE_COLUMNS, self.scene('head-full', 'splatd', 39))
        self.write('machine.csv', ['key', 'value'], {'key': 'vtk', 'value': 'not measured: it is not installed'}, {'key': 'scenes, measured again', 'value': 'today'})
        first, headline = self.make()
        text = self.page('speed')
        self.assertIn('not measured: it is not installed', first)
        self.assertNotIn('today', first)
        self.assertEqual(self.line(text, '| head-full')[2:7], ['39', '–', '–', '–', '5×: –, 40 fps: **missed**'])
        self.assertNotIn('cancelling', text)
        self.assertNotIn('times VTK', headline)
        self.assertEqual(re.findall(r'\((\w+\.md)\)', first), ['speed.md'])
        self.assertEqual(self.line(text, '| [scenes.csv]')[2], 'today')
        self.assertEqual(re.findall(r'\[(\w+\.csv)\]', text), ['scenes.csv'])

    def test_the_first_page_fits_a_screen(self):
        results = os.path.join(HERE, 'results')
        for name in os.listdir(results):
            if name.endswith('.csv'):
                shutil.copy(os.path.join(results, name), self.folder.name)
        first, _ = self.make()
        self.assertLessEqual(len(first.split('\n')), 80)
        for page in report.PAGES:
            text = self.page(page.name)
            self.assertLess(len(text.split('\n')), 150, page.name)
            with open(os.path.join(results, page.name + '.md'), encoding='utf-8') as f:
                self.assertEqual([line for line in f.read().split('\n') if line.startswith('|')], [line for line in text.split('\n') if line.startswith('|')])

    def test_goals_are_counted(self):
        text = '| what | goal |\n|---|---|\n| a | 5×: met, 40 fps: **missed** |\n| b | met |\n| c | **missed**: why |\nnot | met |\n'
        self.assertEqual(tables.verdicts(text), (2, 2, ['a', 'c']))

    def test_notes_are_linked(self):
        stages = ['scene', 'size', 'threads', 'shading', 'isa', 'splats', 'fragments', 'median_ms', 'mean_ms', 'classify_ms', 'tile_ms']
        self.write('scenes.csv', run_all.SCENE_COLUMNS, self.scene('engine', 'splatd', 100))
        self.write('profile.csv', stages, {'scene': 'engine', 'size': 512, 'threads': 2, 'shading': 'none', 'isa': 'avx2',
                                           'splats': 1000000, 'fragments': 25000000, 'median_ms': 40, 'mean_ms': 40,
                                           'classify_ms': 10, 'tile_ms': 30})
        self.write('limit.csv', run_all.LIMIT_COLUMNS,
                   {'isa': 'avx2', 'threads': 2, 'add_3': 200, 'add_5': 100, 'add_7': 50, 'add_11': 25, 'set_up': 100, 'read': 1, 'copy': 1},
                   {'isa': 'scalar', 'threads': 2, 'add_3': 2, 'add_5': 1, 'add_7': 1, 'add_11': 1, 'set_up': 1, 'read': 1, 'copy': 1})
        os.mkdir(os.path.join(self.folder.name, 'notes'))
        with open(os.path.join(self.folder.name, 'notes', 'speed.md'), 'w', encoding='utf-8') as f:
            f.write('The rest waits for memory.\n')
        self.make()
        self.assertEqual(re.findall(r'\(notes/(\w+)\.md\)', self.page('speed')), ['speed'])
        # A million splats of 25 px: 10 ms to add and 10 ms to set up, of 40.
        self.assertEqual(self.line(scene_tables.profile(self.folder.name), '| engine')[1:], ['40', '25 %', '75 %', '25', '25', '50 %'])

    def test_the_limit_between_widths(self):
        rates = {3: 100, 5: 50, 7: 25, 11: 10}
        self.assertAlmostEqual(scene_tables.add_cost(rates, 4), 1e-8)
        self.assertAlmostEqual(scene_tables.add_cost(rates, 17), 1.5e-8)
        self.assertAlmostEqual(scene_tables.add_cost(rates, 49), 4e-8)
        self.assertAlmostEqual(scene_tables.add_cost(rates, 242), 2e-7)

    def goal(self, start):
        """Measured value and verdict of one goal of the renderer."""
        return self.line(report.goals(self.folder.name), '| ' + start)[2:4]

    def test_goals_of_the_renderer(self):
        pair = {'scene': 'lobster', 'zoom': 1, 'splats': 1000, 'median_ms': 10, 'against_median_ms': 12, 'speedup': 1.2, 'cpu_speedup': 1.2,
                'psnr_db': 60, 'psnr_worst_db': 44}
        self.write('adaptive.csv', run_all.PAIR_COLUMNS, pair)
        self.assertEqual(self.goal('lobster: adaptive'), ['20 %', '**missed**'])
        self.assertEqual(self.goal('adaptive against ewa'), ['44.0 dB', '**missed**'])
        self.write('detail.csv', run_all.PAIR_COLUMNS, pair)
        self.assertEqual(self.goal('level of detail'), ['44.0 dB', 'met'])
        self.write('edits.csv', run_all.PAIR_COLUMNS, {**pair, 'setting': 'edit=colour', 'speedup': 0.9})
        self.assertEqual(self.goal('frame rate while'), ['90 % at worst (lobster, colour)', 'met'])
        self.write('edits.csv', run_all.PAIR_COLUMNS, {**pair, 'setting': 'edit=range', 'speedup': 0.89},
                   {**pair, 'setting': 'edit=colour', 'speedup': 0.9})
        self.assertEqual(self.goal('frame rate while'), ['89 % at worst (lobster, range)', '**missed**'])
        stopped = {'scene': 'head', 'what': 'frame', 'stopped': 50, 'range_ms': 40, 'median_ms': 1}
        self.write('cancel.csv', run_all.CANCEL_COLUMNS, {**stopped, 'worst_ms': 5.1}, {**stopped, 'stopped': 0, 'worst_ms': 9})
        self.assertEqual(self.goal('cancelling'), ['5.1 ms at worst (head)', '**missed**'])
        self.write('scenes.csv', run_all.SCENE_COLUMNS, self.scene('engine', 'splatd', 100, derived_per_voxel=2.1),
                   self.scene('engine', 'splatd', 60, threads=1), self.scene('head', 'splatd', 60))
        self.assertEqual(self.goal('cached bytes'), ['2.10 at worst (engine)', '**missed**'])
        self.assertEqual(self.goal('two threads'), ['1.67× to 1.67×', '–'])
        self.write('tls.csv', ['what', 'median_ms', 'slowest_ms'], {'what': 'handshake', 'median_ms': 2.4, 'slowest_ms': 216},
                   {'what': 'echo of 4 MiB', 'median_ms': 17, 'slowest_ms': 200})
        self.assertEqual(self.goal('TLS'), ['200 ms', '**missed**'])

    def gl(self, scene, size, fps, **more):
        row = {'scene': scene, 'backend': 'gl', 'device': 'a card', 'size': size, 'shading': 'none', 'views': 24, 'splats': 1000000,
               'fragments': 0, 'fps': fps, 'median_ms': 1000 / fps, 'mean_ms': 1000 / fps, 'splats_per_second': 1e6 * fps, 'classify_ms': 0,
               'splat_ms': 250 / fps, 'bin_ms': 0, 'tile_ms': 500 / fps, 'resolve_ms': 0, 'read_ms': 100 / fps, 'rest_ms': 150 / fps, 'cpu_fps': 10,
               'in_flight_2_fps': 1.5 * fps}
        return {**row, **more}

    def test_goals_on_a_gpu(self):
        self.write('gl.csv', gpu.GL_COLUMNS, self.gl('engine', 512, 1000, peak_gb_s=1000, peak_tflop_s=10), self.gl('head-full', 512, 499, in_flight_2_fps=498),
                   self.gl('sparse', 1024, 200))
        text = report.gpu(self.folder.name)
        # 92 bytes and 824 operations per splat without extent, 76 bytes per pixel, in a millisecond.
        self.assertIn('| engine | 512 | 1000 | 1000 | 1500 | – | – | 11.2 % | 8.2 % | met |', text)
        self.assertIn('| head-full | 512 | 500 | 499 | 498 | – | – | – | – | **missed** |', text)
        self.assertIn('| sparse | 1024 | 200 | 200 | 300 | – | – | – | – | met |', text)
        self.assertIn('| checkerboard | 512 | 1000 | – | – | – | – | – | – | not measured |', text)
        self.assertIn('Device: a card. Backend `gl`', text)
        self.assertNotIn(scene_tables.SOFTWARE, text)
        self.assertNotIn('takes too long', text)
        self.assertNotIn('transfer function', text)

    def test_software_gl_is_not_judged(self):
        self.write('gl.csv', gpu.GL_COLUMNS, self.gl('engine', 512, 2000, backend='gl-software', peak_gb_s=1, peak_tflop_s=1))
        text = report.gpu(self.folder.name)
        self.assertNotIn('| met |', text)
        self.assertNotIn('missed', text)
        self.assertEqual(text.count(f'| {scene_tables.SOFTWARE} |'), len(gpu_tables.GOAL_GPU))
        self.assertIn(f'| engine | 512 | 1000 | 2000 | 3000 | – | – | – | – | {scene_tables.SOFTWARE} |', text)
        self.assertEqual({scene for scene, _ in gpu_tables.GOAL_GPU}, {'engine', 'bonsai', 'lobster', 'head', 'head-full', 'checkerboard', 'sparse'})

    def test_elements_on_a_gpu(self):
        self.write('gl.csv', gpu.GL_COLUMNS, self.gl('engine', 512, 1000))
        self.assertNotIn('triangles', report.gpu(self.folder.name))
        self.write('gl_elements.csv', run_all.ELEMENT_COLUMNS,
                   {'volume': 'demo:torus', 'layer': '', 'mip': 0, 'splats': 131072, 'median_ms': 2, 'cpu_ms': 1, 'fps': 500})
        self.assertIn('| demo:torus |  | 0 | 131,072 | 2 | 1 | 500 |', report.gpu(self.folder.name))

    def test_goals_of_elements(self):
        row = {'mip': 0, 'threads': 2, 'splats': 1, 'median_ms': 90, 'fps': 11}
        self.write('elements.csv', run_all.ELEMENT_COLUMNS, {**row, 'volume': 'demo:gaussians?size=274', 'layer': '', 'cpu_ms': 32},
                   {**row, 'volume': 'demo:tornado', 'layer': 'vectors, density 1', 'cpu_ms': 63}, {**row, 'volume': 'demo:tornado', 'layer': 'volume', 'cpu_ms': 30})
        text = report.elements(self.folder.name)
        self.assertIn('that the CPU time allows | 60 | 62.5 | met |', text)
        self.assertIn('CPU time | 2 | 2.1 | **missed** |', text)

    def test_goals_of_a_drag(self):
        self.write('drag.csv', ['volume', 'px', 'side', 'coarse', 'fps_mean', 'final_ms'],
                   {'volume': 'demo:points', 'px': 512, 'side': 448, 'coarse': 2, 'fps_mean': 29, 'final_ms': 812})
        text = report.elements(self.folder.name)
        self.assertIn('448 of 512 px, mip level 2 | 30 | 29 | **missed** | drag.csv |', text)
        self.assertIn('final frame after the last change, ms | none | 812 | – | drag.csv |', text)

    def test_frames_that_take_too_long_are_named(self):
        late = {'scene': 'head', 'backend': 'gl', 'device': 'a card', 'size': 2048, 'shading': 'phong', 'views': 24, 'left_out': 'more than 600 s'}
        self.write('gl.csv', gpu.GL_COLUMNS, self.gl('engine', 512, 1000), late, {**late, 'size': 4096})
        self.assertIn('a frame takes too long: head at 2048 px; head at 4096 px.', report.gpu(self.folder.name))
        self.write('gl.csv', gpu.GL_COLUMNS, late)
        self.assertIn('| engine | 512 | 1000 | – | – | – | – | – | – | not measured |', report.gpu(self.folder.name))

    def test_edits_on_a_gpu(self):
        edit = {'scene': 'engine', 'zoom': 1, 'backend': 'gl', 'setting': 'edit=range', 'median_ms': 10, 'against_median_ms': 8.9, 'speedup': 0.89,
                'cpu_speedup': 1}
        late = {'scene': 'head', 'backend': 'gl', 'setting': 'edit=opacity', 'left_out': 'more than 600 s'}
        self.write('gl.csv', gpu.GL_COLUMNS, self.gl('engine', 512, 1000))
        for backend, verdict in ('gl', '**missed**'), ('gl-software', scene_tables.SOFTWARE):
            self.write('gl_edits.csv', gpu.GL_EDIT_COLUMNS, {**edit, 'backend': backend}, late)
            self.assertIn(f'| 89 % at worst (engine, range) | {verdict} |', report.gpu(self.folder.name))

    def serve(self, part, what, **more):
        return {'part': part, 'what': what, 'volume': 'demo:engine', 'clients': 1, 'px': 512, 'side': 512, 'coarse': 0, 'fps_min': 30, 'fps_mean': 30, **more}

    def test_latency(self):
        def motion(fps, wait, **more):
            return self.serve('motion', f'null, 60 changes per second, max_fps {fps}', work_ms=2, p50_ms=wait + 2, p95_ms=15, wait_p50_ms=wait, wait_p95_ms=13, **more)
        request = {'work_ms': 12, 'wait_p50_ms': 1}
        self.write('latency.csv', SERVE_COLUMNS, motion(60, 4), motion(120, 4.1), motion(30, 33), motion(60, 4, clients=8),
                   self.serve('loop', 'cpu', wait_p95_ms=3, **request), self.serve('loop', 'null', wait_p95_ms=3.1, **request),
                   self.serve('loop', 'cpu', wait_p95_ms=30, **{**request, 'clients': 4}))
        text = report.latency(self.folder.name)
        self.assertIn('| null, 60 changes per second, max_fps 60 | 1 | 30 | 2 | 6 | 15 | 4 | 13 | met |', text)
        self.assertIn('| null, 60 changes per second, max_fps 60 | 8 | 30 | 2 | 6 | 15 | 4 | 13 | met |', text)
        self.assertIn('max_fps 120 | 1 | 30 | 2 | 6.1 | 15 | 4.1 | 13 | **missed** |', text)
        self.assertIn('max_fps 30 | 1 | 30 | 2 | 35 | 15 | 33 | 13 | – (max_fps) |', text)
        self.assertIn('| cpu | 1 | 30 | 12 | 1 | 3 | met |', text)
        self.assertIn('| null | 1 | 30 | 12 | 1 | 3.1 | **missed** |', text)
        self.assertIn('| cpu | 4 | 30 | 12 | 1 | 30 | – |', text)

    def test_browser(self):
        columns = ['what', 'volume', 'px', 'count', 'fps', 'p50_ms', 'p95_ms', 'render_p50_ms', 'render_p95_ms', 'allowed_ms']
        first = {'what': 'first', 'volume': 'demo:engine', 'px': 1024, 'count': 7, 'fps': '', 'p50_ms': 700, 'p95_ms': 900, 'render_p50_ms': '', 'render_p95_ms': '', 'allowed_ms': ''}
        turn = {**first, 'what': 'turn', 'fps': 30, 'p50_ms': 40, 'p95_ms': 80, 'render_p50_ms': 20, 'render_p95_ms': 25, 'allowed_ms': 85}
        self.write('browser.csv', columns, first, turn, {**turn, 'what': 'points', 'fps': 26.9, 'p95_ms': 90})
        text = report.browser(self.folder.name)
        self.assertIn('| demo:engine | 700 | met | 30 | 40, 80 of 85 | met | 26.9 | 40, 90 of 85 | **missed** | **missed** |', text)
        self.write('browser.csv', columns, {**first, 'p50_ms': 1001}, turn, {**turn, 'what': 'points', 'fps': 27})
        self.assertIn('| demo:engine | 1001 | **missed** | 30 | 40, 80 of 85 | met | 27 | 40, 80 of 85 | met | met |', report.browser(self.folder.name))

    def test_volumes_larger_than_memory(self):
        row = {'side': 1024, 'memory_bytes': 512 << 20, 'matter_bytes': 64 << 20, 'file_bytes': 3 << 19, 'convert_ms': 1300, 'convert_cpu_ms': 1000, 'convert_peak_bytes': 32 << 20,
               'view': 'default', 'width': 1920, 'height': 1080, 'load_ms': 160, 'first_ms': 40, 'complete_ms': 9000, 'is_complete': 1, 'level': 1, 'asked': 1, 'bricks': 260,
               'read_bytes': 271700, 'peak_bytes': 563 << 20}
        last = {'side': 4096, 'matter_bytes': '', 'convert_ms': '', 'convert_cpu_ms': '', 'convert_peak_bytes': ''}
        self.write('bricks.csv', list(row), row, {**row, 'is_complete': 0, 'asked': 0}, {**row, 'complete_ms': 10001}, {**row, 'first_ms': 841}, {**row, 'peak_bytes': 564 << 20},
                   {**row, 'view': 'near', 'is_complete': 0, 'asked': 0, 'complete_ms': 20000, **last})
        lines = report.bricks(self.folder.name).split('\n')
        self.assertEqual(lines[2], '| 1024³ | default, 1920 × 1080 | 160 + 40 | 9000 | 1 | 260 | 272 | 563 | met |')
        self.assertEqual([line.split('|')[5].strip() for line in lines[3:8]], ['1 of 0', '1', '1', '1', '1 of 0'])
        self.assertEqual([line.split('|')[-2].strip() for line in lines[3:8]], ['**missed**: finer levels do not fit', *['**missed**'] * 3, 'met'])
        self.assertEqual(lines[-2:], ['| 1024³ | 1 | 64 | 1.5 | 1.3 | 1 | 32 |', ''])

    def test_network(self):
        columns = ['rtt_ms', 'mbit', 'stalls_percent', 'format', 'fps_mean', 'p50_ms', 'allowed_ms']
        cell = {'rtt_ms': 0, 'mbit': 2, 'stalls_percent': 1, 'format': 'auto', 'fps_mean': 59.6, 'p50_ms': 21, 'allowed_ms': 38}
        self.write('network.csv', columns, cell, {**cell, 'rtt_ms': 50, 'p50_ms': 99, 'allowed_ms': 88}, {**cell, 'mbit': 10})
        text = report.network(self.folder.name)
        self.assertIn('| Mbit/s | stalls | format | round trip 0 ms | round trip 50 ms |', text)
        self.assertIn('| 2 | 1 % | auto | 60 fps, 21 ms of 38 | 60 fps, 99 ms of 88 ✗ |', text)
        self.assertIn('| 10 | 1 % | auto | 60 fps, 21 ms of 38 | – |', text)

    def test_exact(self):
        columns = ['field', 'shading', 'method', 'psnr_db', 'rise_px', 'exact_rise_px', 'ms']
        shell = {'field': 'shell', 'shading': 'none', 'method': 'sheets', 'psnr_db': 58.71, 'rise_px': 5.4, 'exact_rise_px': 5.43, 'ms': 5.99}
        tubes = {**shell, 'field': 'tubes', 'rise_px': '', 'exact_rise_px': ''}
        self.write('exact.csv', columns, shell, tubes, {**shell, 'method': 'VTK', 'psnr_db': 37.4}, {**tubes, 'method': 'new'},
                   {**tubes, 'shading': 'phong', 'psnr_db': 41.23, 'ms': 12.34})
        text = report.exact(self.folder.name)
        self.assertIn('| method | shell | tubes | edge of the shell |', text)
        self.assertIn('| sheets | 58.7 dB, 6 ms | 58.7 dB, 6 ms | 5.40 of 5.43 px |', text)
        self.assertIn('| VTK | 37.4 dB, 6 ms | – | 5.40 of 5.43 px |', text)
        self.assertIn('| new | – | 58.7 dB, 6 ms | – |', text)
        self.assertIn('| method | tubes |\n', text)
        self.assertIn('| sheets | 41.2 dB, 12 ms |\n', text)
        self.assertLess(text.index('Unshaded:'), text.index('Shaded:'))
        self.assertNotIn('noise', text)

    def test_exact_with_noise(self):
        columns = ['field', 'shading', 'samples', 'method', 'psnr_db', 'rise_px', 'exact_rise_px', 'ms']
        clean = {'field': 'tubes', 'shading': 'phong', 'samples': '16 bits', 'method': 'sheets', 'psnr_db': 41.23, 'rise_px': '', 'exact_rise_px': '', 'ms': 5}
        noisy = {**clean, 'samples': '8 bits, noise 3 %', 'psnr_db': 33.44}
        self.write('exact.csv', columns, clean, noisy, {**noisy, 'method': 'VTK', 'psnr_db': 34.5}, {**noisy, 'field': 'shell', 'psnr_db': 38.2})
        text = report.exact(self.folder.name)
        self.assertIn('| sheets | 41.2 dB, 5 ms |\n', text)
        self.assertIn('| samples | method | tubes | shell |', text)
        self.assertIn('| 8 bits, noise 3 % | sheets | 33.4 dB | 38.2 dB |', text)
        self.assertIn('| 8 bits, noise 3 % | VTK | 34.5 dB | – |', text)

    def test_exact_with_narrow_samples(self):
        columns = ['field', 'shading', 'samples', 'method', 'psnr_db', 'rise_px', 'exact_rise_px', 'ms', 'change']
        clean = {'field': 'tubes', 'shading': 'none', 'samples': '16 bits', 'method': 'sheets', 'psnr_db': 41.23, 'rise_px': '', 'exact_rise_px': '', 'ms': 5,
                 'change': ''}
        narrow = {**clean, 'samples': '16 bits, 1 px wide', 'psnr_db': 38.66, 'change': 1.24}
        self.write('exact.csv', columns, clean, narrow, {**narrow, 'method': 'exact', 'psnr_db': '', 'ms': '', 'change': 1.1})
        text = report.exact(self.folder.name)
        self.assertIn('| sheets | 38.7 dB, 1.2 |\n', text)
        self.assertIn('| exact | 1.1 |\n', text)
        self.assertEqual(report.exact_headline(self.folder.name), '')

    def test_scans(self):
        columns = ['scene', 'shading', 'size', 'march_db', 'means_db', 'change', 'point_change']
        head = {'scene': 'head', 'shading': 'none', 'size': 256, 'march_db': 33.21, 'means_db': 44.44, 'change': 1.26, 'point_change': 1.8}
        self.write('scans.csv', columns, head, {**head, 'shading': 'phong', 'means_db': 42.1}, {**head, 'size': 512, 'march_db': ''})
        text = report.scans(self.folder.name)
        self.assertIn('| head | 256² | 33.2 dB | 44.4 dB | 1.26, 1.80 | 33.2 dB | 42.1 dB | 1.26, 1.80 |', text)
        self.assertIn('| head | 512² | – | 44.4 dB | 1.26, 1.80 | – | – | – |', text)

    def test_layers(self):
        row = {'scene': 'engine', 'setting': 'shell fast', 'speedup': 7.31, 'cpu_speedup': 8.09}
        self.write('layers.csv', run_all.PAIR_COLUMNS, row, {**row, 'setting': 'mean', 'speedup': 0.5, 'cpu_speedup': 0.55}, {**row, 'setting': 'shell fast and volume'})
        self.assertIn('| engine | 7.3, 8.1 | – | – | – | 0.5, 0.6 |', report.layers(self.folder.name))

    def test_codecs(self):
        columns = ['scene', 'size', 'codec', 'quality', 'key_bytes', 'bytes', 'ms', 'cpu_ms']
        vp9 = {'scene': 'a.nrrd', 'size': 1024, 'codec': 'vp9', 'quality': 60, 'key_bytes': 12345, 'bytes': 2109, 'ms': 11.1, 'cpu_ms': 9}
        self.write('codecs.csv', columns, vp9, {**vp9, 'scene': 'b.nrrd', 'codec': 'png'})
        text = report.codecs(self.folder.name)
        self.assertIn('| vp9 | 60 | 12.3 | 2.11 | 11.1 | 9 |', text)
        self.assertIn('a.nrrd at 1024².', text)
        self.assertNotIn('png', text)

    def test_goals_of_the_daemon(self):
        """Each goal is just met and then just missed."""
        for missed in False, True:
            rows = [self.serve('overhead', 'JPEG', px=512, p95_ms=99), self.serve('overhead', 'JPEG', px=1024, p95_ms=5 + missed / 10),
                    self.serve('viewers', 'of one view', clients=8), self.serve('viewers', 'of one view', clients=63, fps_min=10 - missed),
                    self.serve('sessions', 'as time allows', clients=16, fps_min=20), self.serve('sessions', 'full side', clients=4, fps_min=10),
                    self.serve('sessions', 'full side', clients=5, fps_min=9.9),
                    self.serve('memory', 'a viewer, jpeg', kib_each=2048 + missed), self.serve('memory', 'a session, vp9', kib_each=16384 + missed),
                    self.serve('hostile', 'slow', change_percent=3), self.serve('hostile', 'greedy', change_percent=-5 - missed / 10),
                    self.serve('beside', '8 sessions', change_percent=-60, note='changes -60 %; the others'),
                    self.serve('idle', 'over', wanted=10000, limit=1000, held=1050 if not missed else 5000, refused=8950),
                    self.serve('idle', 'within', wanted=10000, limit=12000, held=10000, refused=int(missed))]
            soak = [{'minute': m, 'rss_mib': mib, 'descriptors': 20 + 2 * missed * (m == 4)} for m, mib in ((1, 10), (2, 100), (3, 1), (4, 104.9 + missed))]
            self.write('serve.csv', SERVE_COLUMNS, *rows)
            self.write('soak.csv', ['minute', 'clients', 'errands', 'sessions', 'rss_mib', 'descriptors', 'failed'], *soak)
            text = report.serve(self.folder.name)
            goals, hostile = text.split('One user at')
            self.assertIn(f'{5 + missed / 10:.1f} % at worst (greedy)', goals)
            self.assertEqual(self.line(goals, '| number of sessions at full')[2:], ['4', 'met'])
            self.assertEqual(self.line(goals, '| number of viewers of one')[2], '8' if missed else '63')
            self.assertIn(f'; {2 - missed} of 2 behaviours meet the goal', self.line(goals, '| frame rate lost')[0])
            self.assertEqual((goals.count('| met |'), goals.count('**missed**')), (1, 9) if missed else (10, 0))
            self.assertEqual(self.line(hostile, '| greedy')[1], '-5.1 %' if missed else '-5.0 %')
            self.assertEqual(self.line(hostile, '| greedy')[-1], '**missed**' if missed else 'met')
            self.assertIn('All clients view demo:engine.', goals)

    def a_run(self):
        run = run_all.Run(None)
        self.addCleanup(os.rmdir, run.work)
        run.say = lambda text: None
        return run

    def load_scenes(self, quick):
        run = self.a_run()
        run.o, said = types.SimpleNamespace(scenes=self.folder.name, data=self.folder.name, quick=quick), []
        run.say = said.append
        run.load_scenes()
        return run, said

    def test_scenes_that_take_long_are_measured_by_some_parts(self):
        run, said = self.load_scenes(quick=False)
        self.assertEqual(set(run.scenes), {'checkerboard', 'sparse'})
        self.assertEqual(set(run.scenes_of('scenes')), {'checkerboard', 'sparse', 'turbulence', 'noise'})
        self.assertEqual(set(run.scenes_of('edits')), set(run.scenes))
        self.assertEqual(set(run_all.demos(run.scenes_of('scenes'))), set(run.scenes_of('scenes')))
        self.assertTrue(any(text.startswith('skipped: bonsai-soft; no bonsai_256') for text in said))
        run, said = self.load_scenes(quick=True)
        self.assertEqual(set(run.scenes_of('scenes')), {'checkerboard', 'sparse'})
        self.assertIn('skipped: noise; its frames take long (--quick)', said)

    def test_a_program_that_takes_too_long_is_stopped(self):
        run = self.a_run()
        self.assertIsNone(run.program('endless', ['tail', '-f', os.devnull], limit=0.1))
        self.assertIsNone(run.call('endless', ['tail', '-f', os.devnull], limit=0.1))
        self.assertEqual(run.failed, [])
        self.assertEqual(run.call('brief', ['echo', '{"scene": "a"}'], limit=60), [{'scene': 'a'}])
        self.assertEqual(run.call('wrong', ['false'], limit=60), [])
        self.assertEqual(run.failed, ['wrong: exit status 1'])

    def test_a_scene_that_is_too_slow_is_skipped_at_larger_sizes(self):
        run, slow = self.a_run(), {}
        run.o = types.SimpleNamespace(gpu_peak=('', ''))
        run.gpu = types.SimpleNamespace(backend='gl-software', device='a card', views=2, limit=30)
        run.files = lambda views, names: ['scene.json']
        run.bench = lambda *arguments, **options: None
        rows = gpu.gl_rows(run, 'head', 'none', '512 px', ('--size', 512), 10, slow)
        run.bench = None
        rows += gpu.gl_rows(run, 'head', 'none', '1024 px', ('--size', 1024), 10, slow)
        self.assertEqual([(row['size'], row['left_out']) for row in rows], [(512, 'more than 30 s at 512 px'), (1024, 'more than 30 s at 512 px')])
        drawn = [{'scene': 'head', 'fps': 5, 'stages': {'read': 2}}, {'scene': 'head', 'fps': 8, 'stages': {}}]
        run.bench = lambda *arguments, **options: [drawn['--in-flight' in arguments]]
        row, = gpu.gl_rows(run, 'head', 'phong', '512 px', ('--size', 512), 10, slow)
        self.assertEqual((row['fps'], row['in_flight_2_fps'], row['read_ms'], row['cpu_fps']), (5, 8, 2, 10))

    def test_elements_that_are_too_slow_are_left_out(self):
        run = self.a_run()
        run.o = types.SimpleNamespace(quick=True, data='/nowhere')
        run.bench = lambda label, *arguments, **options: None if 'torus' in label else [{'fps': 5, 'backend': options['backend']}]
        rows = run_all.element_rows(run, 2, backend='gl', limit=1)
        self.assertEqual({row['backend'] for row in rows}, {'gl'})
        self.assertIn(('demo:tornado', 'vectors, density 1', 5), {(row['volume'], row['layer'], row['fps']) for row in rows})
        self.assertNotIn('demo:torus', {row['volume'] for row in rows})

    def test_a_failed_measurement_keeps_the_old_table(self):
        run = self.a_run()
        run.o = types.SimpleNamespace(bin='.', out=self.folder.name)
        run.write('soak.csv', ['minute'], [{'minute': 20}])
        why, run_all.missing = run_all.missing, lambda *needs: ''
        self.addCleanup(setattr, run_all, 'missing', why)

        def program(fails):
            def half(label, command):
                with open(command[command.index('--out') + 1], 'w', encoding='utf-8') as f:
                    f.write('minute\n1\n')
                run.failed += ['it'] * fails
            return half
        for fails, minute in (True, 20), (False, 1):
            run.program = program(fails)
            run_all.measure_serve(run, 'soak.csv', 'it', '--only', 'soak')
            self.assertEqual(report.read(self.folder.name, 'soak.csv'), [{'minute': minute}])
        os.remove(os.path.join(run.work, 'soak.csv'))

    def test_the_soak_runs_only_when_named(self):
        self.assertEqual(set(run_all.PARTS) - set(run_all.DEFAULT_PARTS), {'soak'})

    def test_missing_programs_are_named(self):
        self.assertEqual(run_all.missing('sh', HERE), '')
        self.assertEqual(run_all.missing('sh', 'no-such-program'), 'no-such-program does not exist')
        self.assertEqual(run_all.missing(os.path.join(run_all.ROOT, 'tests/nowhere')), 'tests/nowhere does not exist')

    def test_the_peak_of_a_gpu_is_two_numbers(self):
        self.assertEqual(run_all.peaks('4800,67'), (4800, 67))
        for wrong in '4800', '4800,0', '4800,-1', 'a,b', '1,2,3', 'nan,1', 'inf,1':
            self.assertRaises(ValueError, run_all.peaks, wrong)

    def test_a_folder_without_results(self):
        for folder, status in (self.folder.name, 1), (os.path.join(self.folder.name, 'none'), 2):
            done = subprocess.run([sys.executable, os.path.join(HERE, 'report.py'), folder], capture_output=True, text=True, check=False)
            self.assertEqual(done.returncode, status)
            self.assertTrue(done.stderr)

    def test_unknown_parts_are_refused(self):
        done = subprocess.run([sys.executable, os.path.join(HERE, 'run_all.py'), '--bin', '.', '--data', '.', '--scenes', '.', '--out',
                               self.folder.name, '--only', 'limit,tea'], capture_output=True, text=True, check=False)
        self.assertEqual(done.returncode, 2)
        self.assertIn('"tea" is not one of limit, scenes', done.stderr)

    def test_cameras_are_chosen_evenly(self):
        self.assertEqual(run_all.chosen(list(range(24)), 8), list(range(0, 24, 3)))
        self.assertEqual(run_all.chosen([1, 2], 24), [1, 2])


if __name__ == '__main__':
    unittest.main()
