#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Measures everything that tests/bench/results holds, and writes it as CSV files; deploy/bench.sh calls it.

Each row stands beside its baseline of the same run: the peer and the scalar reference follow each setting, and
a comparison of two settings is measured by one process in turns. A measurement that cannot be made says why
and the others go on; exit status 1 then, 0 otherwise.
"""
import argparse
import csv
import datetime
import glob
import json
import math
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time

from gpu import Gpu, gl_rows, GL_COLUMNS, measure_gl_edits, measure_gl_peer, measure_gl_pixels
from pairs import flat, measure_edits, measure_layers, measure_pairs, pair, PAIR_COLUMNS, zooms
from peer import Peer, chosen, demos, describe, find

ROOT = os.path.abspath(os.path.join(os.path.dirname(__file__), '..', '..'))
CORNERS = [(512, 2), (512, 1), (1024, 2), (1024, 1)]  # size in px, threads
PARTS = ('limit', 'scenes', 'pixels', 'exact', 'scans', 'adaptive', 'detail', 'edits', 'layers', 'elements', 'cancel', 'scaling', 'gl', 'serve', 'latency', 'network', 'browser', 'motion', 'bricks', 'memory', 'codecs', 'tls', 'soak')
DEFAULT_PARTS = PARTS[:-1]  # measured without --only
MEMORY_1024 = 3 << 30  # bytes: twice what the largest volume of the scaling takes with its lists


def arguments():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument('--bin', required=True, help='folder of the programs: splatd, splat-bench, splat-limit, splat-codecs, splat-tls-echo')
    p.add_argument('--data', required=True, help='folder of the real volumes')
    p.add_argument('--scenes', required=True, help='folder of their scenes')
    p.add_argument('--out', required=True, help='folder of the CSV files')
    p.add_argument('--vtk-bench', default='', help='script that measures VTK on the same scenes; "" = without')
    p.add_argument('--no-vtk-because', default='', help='reason to print where VTK is not measured')
    p.add_argument('--only', default=','.join(DEFAULT_PARTS), help='parts to measure, of ' + ', '.join(PARTS) + ' (takes 20 minutes and runs only if named); the files of other parts stay')
    p.add_argument('--quick', action='store_true', help='a few views, 512 px, two threads, small volumes')
    p.add_argument('--views', type=int, default=24, help='cameras of each orbit')
    p.add_argument('--gpu-peak', type=peaks, default=('', ''), metavar='GB/s,TFLOP/s',
                   help='memory bandwidth and single-precision arithmetic of the GPU; the page compares with them')
    p.add_argument('--software-limit', type=int, default=30, metavar='S', help='seconds that two views of a scene may take on software GL')
    p.add_argument('--memory-sides', default='', metavar='LIST', help='sides of the images whose memory is measured, px, with commas between')
    p.add_argument('--peer-views', type=int, default=8, help='cameras for VTK at 1024 px, evenly chosen; 24 at 512 px')
    options = p.parse_args()
    options.only = options.only.split(',')
    options.memory_sides = options.memory_sides or ('512' if options.quick else '1024')
    for part in options.only:
        if part not in PARTS:
            p.error(f'--only: "{part}" is not one of {", ".join(PARTS)}')
    return options


def element_runs(run):
    """Returns the volume, mip level, name and layers of each measurement of points, Gaussians, triangles and vectors. Vectors of all samples
    stand beside the splats of these samples; the last row has everything in one frame."""
    many = 'demo:points' + ('' if run.o.quick else '?size=1000')
    volume, vectors = {'type': 'volume'}, {'type': 'vectors', 'density': 1}
    place = [16, 0, 0, 48, 0, 16, 0, 48, 0, 0, 16, 48, 0, 0, 0, 1]
    others = [{'type': kind, 'id': 'demo:' + name, 'transform': place} for kind, name in (('geometry', 'torus'), ('gaussians', 'gaussians'))]
    runs = [('demo:gaussians', 0, '', []), ('demo:gaussians?size=274', 0, '', []), ('guitar.compressed.ply', 0, '', []),
            (many, 0, '', []), (many, 1, '', []), (many, 2, '', []), ('demo:polar', 0, '', []), ('demo:torus', 0, '', []),
            ('demo:tornado', 0, 'vectors, density 0.2', [{'type': 'vectors'}]), ('demo:tornado', 0, 'vectors, density 1', [vectors]),
            ('demo:tornado', 0, 'volume', [volume]),
            ('demo:tornado', 0, 'volume, vectors, geometry and gaussians', [volume, {'type': 'vectors'}, *others])]
    return [(find(run.o.data, name) or name, mip, label, json.dumps(layers) if layers else '') for name, mip, label, layers in runs
            if name.startswith('demo:') or find(run.o.data, name)]


ELEMENT_COLUMNS = ['volume', 'layer', 'mip', 'size', 'threads', 'isa', 'visible_voxels', 'splats', 'fragments', 'median_ms', 'cpu_ms', 'fps',
                   'cold_classify_ms', 'derived_bytes']


def element_rows(run, views, *more, backend='cpu', limit=None):
    """An orbit around each. What takes more than `limit` seconds is left out."""
    rows = []
    for volume, mip, layer, layers in element_runs(run):
        name = os.path.basename(volume)
        own = ('--layers', layers, *(('--compositing', 'splat') if layer == 'volume' else ())) if layers else ()
        label = f'{name}{", " * bool(layer)}{layer}, mip level {mip}' + ('' if backend == 'cpu' else f', {backend}')
        for row in run.bench(label, '--volume', volume, '--size', 512, '--threads', 2, '--coarse', mip, '--views', views, *own, *more,
                             backend=backend, limit=limit) or []:
            rows.append({**row, 'volume': name, 'mip': mip, 'layer': layer})
    return rows


def measure_elements(run):
    """Points, Gaussians, triangles and vectors on the processor."""
    run.write('elements.csv', ELEMENT_COLUMNS, element_rows(run, max(2, run.o.views // 3)))
    measure_serve(run, 'drag.csv', 'a user who drags many points', '--only', 'drag', '--volume', 'demo:points' + ('' if run.o.quick else '?size=1000'),
                  *(('--seconds', '1', '--rounds', '1') if run.o.quick else ()))


def peaks(text):
    numbers = [float(part) for part in text.split(',')]
    if len(numbers) != 2 or not all(0 < n < math.inf for n in numbers):
        raise ValueError
    return tuple(numbers)


class Run:
    """The measurements of one run: paths, progress and failures."""

    def __init__(self, options):
        self.o, self.failed, self.done, self.steps = options, [], 0, 0
        self.work = tempfile.mkdtemp(prefix='splat-bench-')
        self.start = time.monotonic()
        self.shown_seconds = 0.0

    def say(self, text):
        print(text, file=sys.stderr, flush=True)

    def program(self, label, command, limit=None):
        """Returns the output of a program, or '' after reporting a failure. Returns None if it took more than `limit` seconds,
        which is not a failure."""
        self.done += 1
        begun = time.monotonic()
        print(f'[{self.done}/{self.steps}] {label} … ', end='', file=sys.stderr, flush=True)
        try:
            done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=limit or 3600)
            text, problem, status = done.stdout, done.stderr.strip(), done.returncode
        except (OSError, subprocess.TimeoutExpired) as error:
            if limit and isinstance(error, subprocess.TimeoutExpired):
                self.say(f'left out: more than {limit} s')
                return None
            text, problem, status = '', str(error), 1
        self.say(f'{time.monotonic() - begun:.1f} s')
        if problem:
            self.say('    ' + '\n    '.join(problem.splitlines()[-5:]))
        if status:
            self.failed.append(f'{label}: exit status {status}')
        return text

    def call(self, label, command, limit=None):
        """Returns the rows of a program that prints JSON lines; [] after reporting a failure, None as in program()."""
        text = self.program(label, command, limit)
        if text is None:
            return None
        try:
            rows = [json.loads(line) for line in text.splitlines() if line.startswith('{')]
        except json.JSONDecodeError as error:
            self.failed.append(f'{label}: {error}')
            return []
        for row in rows:
            if 'skipped' in row:
                self.say(f'    skipped: {row["scene"]}: {row["skipped"]}')
        return [row for row in rows if 'skipped' not in row]

    def skip(self, steps, text):
        self.done += steps
        self.say('skipped: ' + text)

    def bench(self, label, *arguments, backend='cpu', order='pre', limit=None):
        """Runs splat-bench. All parts but "pixels" classify per voxel, as the papers do."""
        command = [os.path.join(self.o.bin, 'splat-bench'), '--backend', backend, '--order', order, '--data', self.o.data,
                   *map(str, arguments)]
        return self.call(label, command, limit)

    def write(self, name, columns, rows):
        path = os.path.join(self.o.out, name)
        with open(path + '.part', 'w', encoding='utf-8', newline='') as f:
            table = csv.DictWriter(f, columns, restval='', extrasaction='ignore', lineterminator='\n')
            table.writeheader()
            table.writerows(rows)
        os.replace(path + '.part', path)

    def scene_copy(self, name, change):
        """Writes a changed scene file to the work folder."""
        scene = json.loads(json.dumps(self.all_scenes[name]))
        change(scene)
        path = os.path.join(self.work, scene['name'] + f'-{len(os.listdir(self.work))}.json')
        with open(path, 'w', encoding='utf-8') as f:
            json.dump(scene, f)
        return path

    def load_scenes(self):
        """Reads the scenes by name; reports and omits scenes whose files are missing. A scene whose "parts" name some is measured by
        these parts alone, and not with --quick: its frames take long."""
        self.all_scenes = {}
        real = sorted(glob.glob(os.path.join(self.o.scenes, '*.json')))
        if not real:
            self.say(f'skipped: the real scenes; no *.json in {self.o.scenes} (--scenes DIR)')
        for path in real + sorted(glob.glob(os.path.join(ROOT, 'tests/bench/scenes/*.json'))):
            with open(path, encoding='utf-8') as f:
                scene = json.load(f)
            volume = scene['volume']
            if self.o.quick and 'parts' in scene:
                self.say(f'skipped: {scene["name"]}; its frames take long (--quick)')
            elif volume.startswith('demo:') or find(self.o.data, volume):
                self.all_scenes[scene['name']] = scene
            else:
                self.say(f'skipped: {scene["name"]}; no {volume} below {self.o.data} (--data DIR)')
        self.scenes = {name: scene for name, scene in self.all_scenes.items() if 'parts' not in scene}

    def scenes_of(self, part):
        return {name: scene for name, scene in self.all_scenes.items() if part in scene.get('parts', PARTS)}

    def files(self, views, names=None):
        """Returns scene files with evenly chosen cameras."""
        def thin(scene):
            scene['cameras'] = chosen(scene['cameras'], views)
        return [self.scene_copy(name, thin) for name in names or self.scenes]


SCENE_COLUMNS = ['scene', 'size', 'threads', 'shading', 'renderer', 'isa', 'views', 'visible_voxels', 'splats', 'fragments',
                 'median_ms', 'p95_ms', 'cpu_ms', 'fps', 'voxels', 'derived_bytes', 'derived_per_voxel', 'allocations']


def measure_scenes(run, corners, scalar_views):
    """Measures every scene at every corner: this renderer, VTK, and at the first corner the scalar reference, which leaves out scenes
    whose frames take long."""
    rows, stages = [], []
    peer = Peer(run)
    for size, threads in corners:
        for shading in ('none', 'phong'):
            common = ('--size', size, '--threads', threads, '--shading', shading)
            label = describe(size, threads, shading)
            for row in run.bench(f'splatd, {label}', *common, *run.files(run.o.views, peer.scenes)):
                rows.append(flat(row, renderer='splatd'))
                if (size, threads) == corners[0]:
                    stages.append(row)
            if peer.script:
                views = min(run.o.views, 24 if size == 512 else run.o.peer_views)
                rows += [flat(row, renderer='vtk', isa='', shading=shading) for row in peer.measure(size, threads, shading, views)]
            if (size, threads) == corners[0]:
                for row in run.bench(f'scalar reference, {label}', *common, '--isa', 'scalar', '--warm', 1,
                                     *run.files(scalar_views)):
                    rows.append(flat(row, renderer='scalar'))
            run.write('scenes.csv', SCENE_COLUMNS, rows)
    write_profile(run, stages)


PIXEL_COLUMNS = SCENE_COLUMNS + ['psnr_db', 'psnr_worst_db']


def draft_of(row):
    """The drafts of a row that alternated whole frames and drafts."""
    against = row['against']
    return flat(row) | {'renderer': 'draft', 'fps': round(1000 / against['median_ms'], 2)} | {
        key: against.get(key) for key in ('median_ms', 'cpu_ms', 'splats', 'psnr_db', 'psnr_worst_db')}


def measure_pixels(run, sizes):
    """Sheets that are classified per pixel, which most views get by default, and their drafts, beside VTK."""
    rows = []
    peer = Peer(run)
    views = min(run.o.views, run.o.peer_views)
    for size in sizes:
        for shading in ('none', 'phong'):
            label = describe(size, 2, shading)
            for row in run.bench(f'sheets per pixel, {label}', '--size', size, '--threads', 2, '--shading', shading,
                                 '--against', 'draft=1', *run.files(views, peer.scenes), order='post'):
                rows += [flat(row, renderer='splatd'), draft_of(row)]
            if peer.script:
                rows += [flat(row, renderer='vtk', isa='', shading=shading) for row in peer.measure(size, 2, shading, views)]
            run.write('pixels.csv', PIXEL_COLUMNS, rows)


def write_profile(run, rows):
    names = []
    for row in rows:
        names += [n for n in row['stages'] if n not in names]
    columns = ['scene', 'size', 'threads', 'shading', 'isa', 'splats', 'fragments', 'median_ms', 'mean_ms'] + [n + '_ms' for n in names]
    run.write('profile.csv', columns, [flat(row, **{n + '_ms': v for n, v in row['stages'].items()}) for row in rows])


CANCEL_COLUMNS = ['scene', 'size', 'threads', 'what', 'stopped', 'finished', 'median_ms', 'worst_ms', 'range_ms']


def measure_cancels(run, count):
    rows = []
    kinds = [('frame', ()), ('frame and a moved transfer function', ('--edit', 'range')), ('cold frame', ('--cold',))]
    for what, options in kinds:
        for row in run.bench(f'cancelling, {what}', '--size', 1024, '--threads', 2, '--views', 3, '--warm', 1, '--cancel', count,
                             *options, *run.files(3)):
            rows.append({**{k: row[k] for k in ('scene', 'size', 'threads')}, 'what': what, **row['cancel']})
    run.write('cancel.csv', CANCEL_COLUMNS, rows)


LIMIT_COLUMNS = ['isa', 'threads', 'add_3', 'add_5', 'add_7', 'add_11', 'set_up', 'read', 'copy']


def measure_limit(run):
    rows = []
    for threads in (1, 2):
        for isa in ('scalar', 'sse41', 'avx2', 'avx512', 'neon'):
            if isa in run.isas:
                rows += run.call(f'the limit, {isa}, {threads} threads', [os.path.join(run.o.bin, 'splat-limit'), '--threads',
                                                                         str(threads), '--isa', isa])
    for row in rows:
        row.update({'add_' + width: rate for width, rate in row.pop('add').items()})
    run.write('limit.csv', LIMIT_COLUMNS, rows)


SCALING_COLUMNS = ['volume_size', 'voxels', 'size', 'threads', 'views', 'visible_voxels', 'auto_ms', 'off_ms', 'auto_splats', 'off_splats',
                   'psnr_db', 'psnr_worst_db', 'derived_per_voxel', 'peak_rss']


def scaled(run, side, views):
    """Returns the balls at another resolution, with the same size in the image and the same opacity."""
    def change(scene):
        grow = side / 512
        scene.pop('visible_voxels')
        scene['name'], scene['volume'] = f'sparse-{side}', f'demo:sparse?size={side}'
        scene['view']['transfer_function']['reference_length'] *= grow
        scene['cameras'] = chosen(scene['cameras'], views)
        for c in scene['cameras']:
            for key in ('position', 'target'):
                c[key] = [(x + 0.5) * grow - 0.5 for x in c[key]]
    return run.scene_copy('sparse', change)


def measure_scaling(run, sides):
    rows = []
    for side in sides:
        if side == 1024 and available_memory() < MEMORY_1024:
            run.say(f'skipped: 1024³; it takes {MEMORY_1024 >> 30} GiB and {available_memory() >> 30} GiB are free')
            run.done += 2
            continue
        for threads in (1, 2):
            views = min(run.o.views, 1 if side == 1024 else 6)  # a frame of 54 million splats takes seconds
            for row in run.bench(f'scaling, {side}³, {threads} threads', '--size', 512, '--threads', threads, '--warm', 1, '--lod', 'auto',
                                 '--against', 'lod=off', scaled(run, side, views)):
                off = row['against']
                rows.append(flat(row, volume_size=side, auto_ms=row['median_ms'], off_ms=off['median_ms'], auto_splats=row['splats'],
                                 off_splats=off['splats'], psnr_db=off['psnr_db'], psnr_worst_db=off['psnr_worst_db']))
            run.write('scaling.csv', SCALING_COLUMNS, rows)


def measure_gl(run):
    gpu, rows, slow = run.gpu, [], {}
    if not gpu.backend:
        run.say('skipped: the GPU backend; ' + '; '.join(gpu.why))
        return
    for size, shading in gpu.corners:
        common = ('--size', size, '--shading', shading, '--warm', gpu.warm)
        label = f'{size} px, {"shaded" if shading == "phong" else "not shaded"}'
        fps = {row['scene']: row['fps'] for row in run.bench(f'cpu beside the GPU backend, {label}', *common, *run.files(gpu.views))}
        for name in run.scenes:
            rows += gl_rows(run, name, shading, label, common, fps.get(name, ''), slow)
            run.write('gl.csv', GL_COLUMNS, rows)
    if gpu.backend == 'gl':
        measure_gl_pixels(run)
        measure_gl_peer(run)
    measure_gl_edits(run)
    if gpu.backend == 'gl':
        measure_serve(run, 'gl_streams.csv', f'streams, {gpu.backend}', '--only', 'streams', '--backend', 'gl', *(('--seconds', '2') if run.o.quick else ()))
    run.write('gl_elements.csv', ELEMENT_COLUMNS, element_rows(run, max(2, gpu.views // 3), '--warm', gpu.warm, backend=gpu.backend, limit=gpu.limit))


def missing(*needs):
    """Returns which programs or paths are missing; '' if all exist."""
    absent = [need for need in needs if not (os.path.exists(need) if os.sep in need else shutil.which(need))]
    return absent and f'{os.path.relpath(absent[0], ROOT) if os.sep in absent[0] else absent[0]} does not exist' or ''


def keep_table(run, name, text):
    """Parses the CSV output of a program."""
    if text:
        run.write(name, text.splitlines()[0].split(','), csv.DictReader(text.splitlines()))


def measure_serve(run, name, label, *options, program='serve.mjs'):
    """name: the table, which does not change if the program fails."""
    why = missing('node', 'openssl', os.path.join(ROOT, 'tests/node_modules/ws'), os.path.join(run.o.bin, 'splatd'))
    if why:
        run.skip(1, f'{label}; {why} (deploy/test.sh installs what is in tests/node_modules)')
        return
    made, failures = os.path.join(run.work, name), len(run.failed)
    run.program(label, ['node', os.path.join(ROOT, 'tests/bench', program), '--bin', run.o.bin, '--out', made, *options])
    if len(run.failed) == failures:
        with open(made, encoding='utf-8') as f:
            keep_table(run, name, f.read())


def measure_browser(run):
    why = missing('/usr/bin/chromium', os.path.join(ROOT, 'tests/node_modules/playwright-core'))
    if why:
        run.skip(1, f'the page in the browser; {why}')
        return
    real = [find(run.o.data, name) for name in ('bonsai_256x256x256_uint8.nrrd', 'cthead_256x256x113_uint16.nrrd')]
    measure_serve(run, 'browser.csv', 'the page in the browser', '--volumes', ','.join(['demo:engine', *(v for v in real if v)]),
                  *(('--seconds', '2', '--rounds', '1', '--loads', '2') if run.o.quick else ()), program='browser.mjs')


def measure_motion(run):
    why = missing('/usr/bin/chromium', os.path.join(ROOT, 'tests/node_modules/playwright-core'))
    if why:
        run.skip(1, f'what a user sees in motion; {why}')
        return
    names = ('engine_256x256x128_uint8.nrrd', 'cthead_256x256x113_uint16.nrrd', 'bonsai_256x256x256_uint8.nrrd', 'aneurism_256x256x256_uint8.nrrd')
    volumes = [v for v in (find(run.o.data, name) for name in names) if v] or ['demo:engine']
    quick = ('--seconds', '1', '--moves', 'turn', '--px', '512') if run.o.quick else ()
    measure_serve(run, 'motion.csv', 'what a user sees in motion', '--volumes', ','.join(volumes[:1] if run.o.quick else volumes), *quick, program='motion.mjs')
    stops = ('--stops', '1', '--moves', 'turn') if run.o.quick else ()
    measure_serve(run, 'settle.csv', 'what a user sees after the hand stops', '--volumes', ','.join(volumes[:1] if run.o.quick else volumes[:3]), *stops, program='settle.mjs')


def measure_codecs(run):
    volumes = [find(run.o.data, name) for name in ('engine_256x256x128_uint8.nrrd', 'cthead_256x256x113_uint16.nrrd')]
    command = [os.path.join(run.o.bin, 'splat-codecs')] + (['--size', '256', '--frames', '5'] if run.o.quick else [])
    keep_table(run, 'codecs.csv', run.program('codecs', command + ([v for v in volumes if v] or ['demo:engine'])))


def missing_numpy():
    done = subprocess.run(['/usr/bin/python3', '-c', 'import numpy'], capture_output=True, check=False)
    return 'python3-numpy is not installed' if done.returncode else ''


def measure_exact(run):
    why = missing('/usr/bin/python3') or missing_numpy()
    if why:
        run.skip(1, f'the exact images; {why}')
        return
    made = os.path.join(run.work, 'exact.csv')
    sheet = [] if run.o.quick else ['--sheet', os.path.join(run.o.out, 'exact.png')]
    if run.program('against exact images', ['/usr/bin/python3', os.path.join(ROOT, 'tests/bench/exact.py'), '--bin', run.o.bin, '--out', made,
                                            '--vtk-bench', run.o.vtk_bench, *sheet]):
        with open(made, encoding='utf-8') as f:
            keep_table(run, 'exact.csv', f.read())


def measure_scans(run):
    why = missing('/usr/bin/python3') or missing_numpy()
    scenes = run.o.scenes
    if why or not os.path.exists(os.path.join(scenes, 'engine.json')):
        run.skip(1, f'images of scans; {why or "the scenes are missing"}')
        return
    made = os.path.join(run.work, 'scans.csv')
    if run.program('scans', ['/usr/bin/python3', os.path.join(ROOT, 'tests/bench/scans.py'), '--bin', run.o.bin, '--scenes', scenes, '--data', run.o.data,
                             '--out', made, *(['--only', 'engine'] if run.o.quick else [])]):
        with open(made, encoding='utf-8') as f:
            keep_table(run, 'scans.csv', f.read())


def measure_tls(run):
    why = missing('node', 'openssl', os.path.join(run.o.bin, 'splat-tls-echo'))
    if why:
        run.skip(1, f'TLS; {why}')
        return
    keep_table(run, 'tls.csv', run.program('TLS', ['node', os.path.join(ROOT, 'tests/bench/tls_echo.mjs'), run.o.bin]))


def available_memory():
    with open('/proc/meminfo', encoding='ascii') as f:
        return next(int(line.split()[1]) for line in f if line.startswith('MemAvailable')) * 1024


def machine(run):
    """Returns the facts that a reader needs besides the numbers, as (key, value)."""
    def first(path, key, separator):
        with open(path, encoding='utf-8') as f:
            return next((line.split(separator, 1)[1].strip().strip('"') for line in f if line.startswith(key)), '?')

    def output(*command):
        try:
            return subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT).stdout.strip()
        except (OSError, subprocess.CalledProcessError):
            return ''
    changed = output('git', 'status', '--porcelain', '--untracked-files=no', '--', 'renderer', 'server', 'tests/bench')
    yield 'cpu', first('/proc/cpuinfo', 'model name', ':')
    yield 'cores', str(os.cpu_count())
    yield 'memory', f'{int(first("/proc/meminfo", "MemTotal", ":").split()[0]) / 2**20:.1f} GiB'
    yield 'system', f'{first("/etc/os-release", "PRETTY_NAME", "=")}, Linux {platform.release().split("-")[0]}'
    yield 'compiler', output('cc', '--version').split('\n')[0]
    yield 'commit', (output('git', 'rev-parse', '--short', 'HEAD') or '?') + (' with local changes' if changed else '')
    yield 'date', datetime.date.today().isoformat()
    yield 'load at the start', f'{os.getloadavg()[0]:.2f}'
    yield 'instruction set', run.isas[-1] if run.isas else '?'
    yield 'views', f'{run.o.views} (VTK at 1024 px: {min(run.o.views, run.o.peer_views)})'
    if run.gpu:
        yield 'gpu backend', run.gpu.description()
    yield 'vtk', 'measured in the same run' if run.o.vtk_bench else 'not measured: ' + run.o.no_vtk_because


def write_machine(run):
    """Describes the machine of the scenes; later measurements are added with their commit and date."""
    path, now = os.path.join(run.o.out, 'machine.csv'), dict(machine(run))
    if 'scenes' not in run.o.only and os.path.exists(path):
        with open(path, encoding='utf-8', newline='') as f:
            then = {row['key']: row['value'] for row in csv.DictReader(f)}
        then.update({key: value for key, value in now.items() if key == 'gpu backend'})
        where = '' if then.get('cpu') == now['cpu'] else f', on {now["cpu"]}, {now["instruction set"]}'
        then.update({f'{part}, measured again': f'{now["commit"]}, {now["date"]}, load {now["load at the start"]}{where}' for part in run.o.only})
        now = then
    run.write('machine.csv', ['key', 'value'], [{'key': k, 'value': v} for k, v in now.items()])


def known_isas(run):
    """Returns the instruction sets that this machine runs, in rising order."""
    found = []
    for isa in ('scalar', 'sse41', 'avx2', 'avx512', 'neon'):
        done = subprocess.run([os.path.join(run.o.bin, 'splat-bench'), '--isa', isa, '--backend', 'cpu', '--views', '1', '--warm', '0',
                               '--size', '8', '--volume', 'demo:sparse?size=8'], capture_output=True, check=False)
        if done.returncode == 0:
            found.append(isa)
    return found


def main():
    options = arguments()
    os.makedirs(options.out, exist_ok=True)
    run = Run(options)
    try:
        run.isas = known_isas(run)
        run.load_scenes()
        run.gpu = Gpu(run, len(element_runs(run))) if 'gl' in options.only else None
        corners, sides = CORNERS, (64, 128, 256, 512, 1024)
        if options.quick:
            corners, sides = CORNERS[:1], (64, 128)
        if os.cpu_count() < 2:
            run.say('skipped: two threads; this machine has one core')
            corners = [c for c in corners if c[1] == 1] or [(512, 1)]
        peers = len(demos(run.scenes_of('scenes'))) + 2 * len(corners) if options.vtk_bench else 0
        levels = len({z for _, z in zooms(run)})
        sizes = (512,) if options.quick else (512, 1024)
        work = {  # part: (steps, what to call)
            'limit': (2 * len(run.isas), lambda: measure_limit(run)),
            'scenes': (2 * len(corners) + 2 + peers, lambda: measure_scenes(run, corners, min(options.views, 6))),
            'pixels': (2 * len(sizes) + (len(demos(run.scenes_of('scenes'))) + 2 * len(sizes) if options.vtk_bench else 0),
                       lambda: measure_pixels(run, sizes)),
            'exact': (1, lambda: measure_exact(run)),
            'scans': (1, lambda: measure_scans(run)),
            'adaptive': (levels, lambda: measure_pairs(run, 'adaptive.csv', ('--mode', 'adaptive'), 'mode=adaptive', 'mode=ewa')),
            'detail': (levels, lambda: measure_pairs(run, 'detail.csv', ('--lod', 'auto'), 'lod=auto', 'lod=off')),
            'edits': (3, lambda: measure_edits(run)),
            'layers': (6 + len(run.scenes), lambda: measure_layers(run)),
            'elements': (len(element_runs(run)) + 1, lambda: measure_elements(run)),
            'cancel': (3, lambda: measure_cancels(run, 10 if options.quick else 50)),
            'scaling': (2 * len(sides), lambda: measure_scaling(run, sides)),
            'gl': (run.gpu.steps if run.gpu else 0, lambda: measure_gl(run)),
            'serve': (1, lambda: measure_serve(run, 'serve.csv', 'the cost of the daemon and of other clients',
                                               *(('--seconds', '1', '--rounds', '1') if options.quick else ()))),
            'latency': (1, lambda: measure_serve(run, 'latency.csv', 'from a change to its image', '--only', 'motion,loop',
                                                 *(('--seconds', '1') if options.quick else ()))),
            'network': (1, lambda: measure_serve(run, 'network.csv', 'slow and distant networks',
                                                 *(('--seconds', '1', '--rtt', '50', '--mbit', '2', '--stalls', '1') if options.quick else ()), program='network.mjs')),
            'browser': (1, lambda: measure_browser(run)),
            'motion': (1, lambda: measure_motion(run)),
            'bricks': (1, lambda: measure_serve(run, 'bricks.csv', 'volumes that are larger than memory', *(('--sides', '512') if options.quick else ()), program='bricks.mjs')),
            'memory': (1, lambda: measure_serve(run, 'memory.csv', 'the memory of frames', '--sides', options.memory_sides, program='memory.mjs')),
            'codecs': (1, lambda: measure_codecs(run)),
            'tls': (1, lambda: measure_tls(run)),
            'soak': (1, lambda: measure_serve(run, 'soak.csv', 'clients that connect and disconnect', '--only', 'soak', *(('--minutes', '2') if options.quick else ()))),
        }
        run.steps = sum(work[part][0] for part in options.only)
        write_machine(run)
        for part in options.only:
            work[part][1]()
        run.say(f'measured in {(time.monotonic() - run.start) / 60:.1f} minutes')
    finally:
        shutil.rmtree(run.work, ignore_errors=True)
    for failure in run.failed:
        run.say('failed: ' + failure)
    return 1 if run.failed else 0


if __name__ == '__main__':
    sys.exit(main())
