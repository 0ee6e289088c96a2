#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Makes the bench's page from its CSV files: report.py DIR writes DIR/README.md and two charts.

A table whose file is missing is left out. notes.md in the same folder, if there is one, is the paragraph on where
the time goes that no program can write. The headline is printed as well.
"""
import csv
import math
import os
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import charts  # noqa: E402

# Frames a second at 512 × 512 as the papers print them, on their graphics cards (2.4 GHz Pentium 4 with an ATI 9800
# Pro; 1.2 GHz Athlon with a GeForce3).
CHEN_3, CHEN_4 = 'Chen et al. 2004, table 3, adaptive', 'Chen et al. 2004, table 4, retained'
BOTHA = 'Botha and Post 2003, table 1, high quality'
PAPERS = {
    'engine': [(3.25, CHEN_3), (8, BOTHA)],
    'bonsai': [(7.53, CHEN_3)],
    'lobster': [(10.60, CHEN_3)],
    'head': [(3.00, CHEN_3), (6, BOTHA)],
    'head-full': [(2.86, CHEN_4)],
    'aneurism': [(41, BOTHA)],
    'checkerboard': [(6.88, CHEN_4)],
}
# Chen et al., table 3: how much faster adaptive is than ewa, in percent.
CHEN_ADAPTIVE = {'engine': 12, 'bonsai': 9, 'lobster': 21, 'head': 11}
GOAL, GOAL_SPARSE, SPARSE = 5, 10, ('engine', 'bonsai', 'lobster', 'aneurism')
GOAL_FPS = {'head-full': 40}  # at 512 px, two threads, not shaded
GOAL_ADAPTIVE_DB, GOAL_DETAIL_DB, GOAL_EDIT, GOAL_CANCEL_MS, GOAL_BYTES = 45, 40, 0.90, 5, 2
# Of the daemon; GOAL_DISTURBED and GOAL_GROWTH are percent. IDLE_SLACK: a limit has room for clients that are told so.
GOAL_OVERHEAD_MS, GOAL_USER_FPS, GOAL_VIEWER_MIB, GOAL_SESSION_MIB, GOAL_DISTURBED, GOAL_GROWTH, GOAL_ECHO_MS = 5, 10, 2, 16, 5, 5, 200
IDLE_SLACK = 0.1
# On a data-centre GPU, frames a second, not shaded: scene, px.
GOAL_GPU = {(scene, 512): 1000 for scene, found in PAPERS.items() if {CHEN_3, CHEN_4} & {source for _, source in found}}
GOAL_GPU.update({('head-full', 512): 500, ('sparse', 1024): 200})
SOFTWARE = 'software GL, for correctness only'
EQUAL_DB = 999
ORDER = ('engine', 'bonsai', 'bonsai-full', 'lobster', 'head', 'head-full', 'aneurism', 'checkerboard', 'sparse')


def read(folder, name):
    path = os.path.join(folder, name)
    if not os.path.exists(path):
        return []
    with open(path, encoding='utf-8', newline='') as f:
        return [{k: number(v) for k, v in row.items()} for row in csv.DictReader(f)]


def number(text):
    try:
        return float(text)
    except ValueError:
        return text


def table(head, rows):
    if not rows:
        return ''
    lines = ['| ' + ' | '.join(head) + ' |', '|' + '---|' * len(head)]
    return '\n'.join(lines + ['| ' + ' | '.join(str(c) for c in row) + ' |' for row in rows]) + '\n'


def short(value, digits=3):
    """A number with three digits that count; nothing for one that is missing."""
    if value in ('', None):
        return '–'
    if value >= 10 ** (digits - 1):
        return f'{value:.0f}'
    return f'{value:.{digits}g}'


def decibels(value):
    return '–' if value == '' else 'equal' if value >= EQUAL_DB else f'{value:.1f}'


def met(is_met):
    return 'met' if is_met else '**missed**'


def millions(value):
    return f'{value / 1e6:.2f}'


def ordered(rows):
    return sorted(rows, key=lambda r: ORDER.index(r['scene']) if r['scene'] in ORDER else len(ORDER))


def find(rows, **wanted):
    return next((r for r in rows if all(r[k] == v for k, v in wanted.items())), None)


def goal(scene):
    return GOAL_SPARSE if scene in SPARSE else GOAL


def scene_line(rows, own):
    """One row of the table of scenes: this renderer beside its peers at the same setting."""
    where = {k: own[k] for k in ('scene', 'size', 'threads', 'shading')}
    vtk, scalar = (find(rows, renderer=name, **where) for name in ('vtk', 'scalar'))
    ratio = own['fps'] / vtk['fps'] if vtk else None
    verdict = [met(ratio >= goal(own['scene']))] if vtk else ['–']
    wanted = GOAL_FPS.get(own['scene'])
    if wanted and (own['size'], own['threads'], own['shading']) == (512, 2, 'none'):
        verdict.append(f'{wanted} fps: {met(own["fps"] >= wanted)}')
    papers = PAPERS.get(own['scene'], []) if own['size'] == 512 and own['shading'] == 'none' else []
    return [own['scene'], short(own['splats'] / 1e6), short(own['median_ms']), short(own['p95_ms']), short(own['fps']),
            short(vtk['fps']) if vtk else '–', f'{ratio:.1f}' if ratio else '–', f'{goal(own["scene"])}: ' + ', '.join(verdict),
            f'{own["fps"] / scalar["fps"]:.1f}' if scalar else '–',
            ', '.join(f'{own["fps"] / fps:.0f}× {source.split()[0]}' for fps, source in papers) or '–']


SCENE_HEAD = ['scene', 'Msplat drawn', 'median ms', 'p95 ms', 'fps', 'VTK fps', 'times VTK', 'goal, times VTK', 'times scalar',
              'times the papers\' cards']


def scenes(folder):
    rows = read(folder, 'scenes.csv')
    corners = []
    for r in rows:
        corner = (r['size'], r['threads'], r['shading'])
        if corner not in corners:
            corners.append(corner)
    parts = []
    for size, threads, shading in corners:
        own = ordered([r for r in rows if r['renderer'] == 'splatd' and (r['size'], r['threads'], r['shading']) == (size, threads, shading)])
        title = f'{size:.0f} × {size:.0f}, {threads:.0f} thread{"s" if threads > 1 else ""}, {"shaded" if shading == "phong" else "not shaded"}'
        parts.append(f'### {title}\n\n' + table(SCENE_HEAD, [scene_line(rows, r) for r in own]))
    return '\n'.join(parts)


def pairs(folder, file, own, other):
    """Two settings of the same scenes."""
    def line(r):
        return [r['scene'] + ('' if r['zoom'] == 1 else f', {1 / r["zoom"]:g} times as far'), short(r['splats'] / 1e6), short(r['median_ms']),
                short(r['against_median_ms']), f'{100 * (r["speedup"] - 1):+.0f} %', f'{100 * (r["cpu_speedup"] - 1):+.0f} %',
                decibels(r['psnr_db']), decibels(r['psnr_worst_db'])]
    rows = ordered(read(folder, file))
    return rows, table(['scene', 'Msplat', own + ' ms', other + ' ms', 'frames a second', 'by CPU time', 'PSNR dB', 'worst view dB'],
                       [line(r) for r in rows])


def adaptive(folder):
    rows, text = pairs(folder, 'adaptive.csv', 'adaptive', 'ewa')
    if not rows:
        return ''
    worst = min(r['psnr_worst_db'] for r in rows)
    gains = {r['scene']: 100 * (r['speedup'] - 1) for r in rows if r['zoom'] == 1}
    beside = ', '.join(f'{scene} {gain} % ({met(gains[scene] >= gain)})' for scene, gain in CHEN_ADAPTIVE.items() if scene in gains)
    return (f'{text}\nGoals: as much faster as Chen et al. print in table 3: {beside or "none of their scenes was there"}; and {GOAL_ADAPTIVE_DB} dB: '
            f'the worst view has {decibels(worst)} ({met(worst >= GOAL_ADAPTIVE_DB)}).\n')


def detail(folder):
    rows, text = pairs(folder, 'detail.csv', 'auto', 'off')
    if not rows:
        return ''
    worst = min(r['psnr_worst_db'] for r in rows)
    return f'{text}\nGoal: {GOAL_DETAIL_DB} dB against the full set: the worst view has {decibels(worst)} ({met(worst >= GOAL_DETAIL_DB)}).\n'


def edit_table(rows):
    lines = [[r['scene'], r['setting'].split('=')[1], short(r['median_ms']), short(r['against_median_ms']), f'{100 * r["speedup"]:.0f} %',
              f'{100 * r["cpu_speedup"]:.0f} %', SOFTWARE if r.get('backend') == 'gl-software' else met(r['speedup'] >= GOAL_EDIT)] for r in rows]
    return table(['scene', 'what changes at every frame', 'median ms', 'fixed ms', 'frames a second, of fixed', 'by CPU time',
                  f'goal {100 * GOAL_EDIT:.0f} %'], lines)


def edits(folder):
    text = edit_table(ordered(read(folder, 'edits.csv')))
    return text and text + '\nChen et al., tables 4 and 5: 96 to 99 % of the frames a second with lists by value.\n'


def add_cost(rates, area):
    """Seconds that adding one footprint takes at best, by the table of widths; rates in Msplat/s."""
    known = sorted((width * width, 1e-6 / rate) for width, rate in rates.items())
    if area >= known[-1][0]:
        return known[-1][1] * area / known[-1][0]
    if area <= known[0][0]:
        return known[0][1]
    for (a0, t0), (a1, t1) in zip(known, known[1:]):
        if area <= a1:
            return t0 + (t1 - t0) * (area - a0) / (a1 - a0)
    return known[-1][1]


def best_limits(folder, threads):
    """The best of all instruction sets, a width and for the set-up; None if it was not measured."""
    rows = [r for r in read(folder, 'limit.csv') if r['threads'] == threads]
    if not rows:
        return None
    return {width: max(r[f'add_{width}'] for r in rows) for width in (3, 5, 7, 11)}, max(r['set_up'] for r in rows)


def limit_ms(limits, splats, fragments):
    rates, set_up = limits
    return splats * (add_cost(rates, fragments / splats) + 1e-6 / set_up) * 1e3 if splats else 0


def profile(folder):
    rows = ordered(read(folder, 'profile.csv'))
    if not rows:
        return ''
    stages = [k for k in rows[0] if k.endswith('_ms') and k not in ('median_ms', 'mean_ms')]
    lines = []
    for r in rows:
        total = sum(r[s] or 0 for s in stages) or 1
        limits = best_limits(folder, r['threads'])
        line = [r['scene'], 'shaded' if r['shading'] == 'phong' else '', short(r['median_ms'])]
        line += [f'{100 * (r[s] or 0) / total:.0f} %' for s in stages]
        line += [short(r['splats'] / r['median_ms'] / 1e3), short(r['fragments'] / r['median_ms'] / 1e3),
                 short(r['fragments'] / r['splats']) if r['splats'] else '–']
        line += [f'{100 * limit_ms(limits, r["splats"], r["fragments"]) / r["median_ms"]:.0f} %' if limits else '–']
        lines.append(line)
    return table(['scene', '', 'median ms'] + [s[:-3] for s in stages] + ['Msplat/s', 'Mfragment/s', 'px a splat', 'of the limit'], lines)


def limit(folder):
    rows = read(folder, 'limit.csv')
    lines = [[r['isa'], f'{r["threads"]:.0f}'] + [short(r[k]) for k in ('add_3', 'add_5', 'add_7', 'add_11', 'set_up', 'read', 'copy')] for r in rows]
    return table(['instruction set', 'threads', '3×3', '5×5', '7×7', '11×11', 'set-up', 'read GB/s', 'copy GB/s'], lines)


def scaling(folder):
    lines = [[f'{r["volume_size"]:.0f}³', f'{r["threads"]:.0f}', f'{r["views"]:.0f}', millions(r['visible_voxels']), millions(r['auto_splats']), short(r['auto_ms']),
              short(r['off_ms']), f'{r["off_ms"] / r["auto_ms"]:.1f}' if r['auto_ms'] else '–', decibels(r['psnr_worst_db']),
              short(r['derived_per_voxel']), f'{r["peak_rss"] / 2**20:.0f}'] for r in read(folder, 'scaling.csv')]
    return table(['volume', 'threads', 'views', 'M visible', 'Msplat, auto', 'auto ms', 'off ms', 'times', 'worst view dB', 'derived bytes a voxel',
                  'peak MiB'], lines)


GPU_TILE = 8  # px, as in backend/gl/program.h


def gpu_work(splats, fragments, pixels):
    """Bytes and operations of a frame by the model that GPU_EXPLAINED states."""
    side = math.sqrt(4 / math.pi * fragments / splats) if splats else 0
    pairs = splats * (1 + side / GPU_TILE) ** 2
    return splats * 52 + pairs * 40 + pixels * 76, splats * 120 + pairs * GPU_TILE ** 2 * 11 + fragments * 16


def gpu_shares(row, amounts):
    """Fractions of the device's memory bandwidth and arithmetic, where both were told."""
    if row['backend'] != 'gl' or not row['peak_gb_s']:
        return ['–', '–']
    seconds = row['median_ms'] / 1e3
    return [f'{100 * amount / seconds / (peak * unit):.1f} %'
            for amount, peak, unit in zip(amounts, (row['peak_gb_s'], row['peak_tflop_s']), (1e9, 1e12))]


def gpu_goals(backend, rows):
    lines = []
    for (scene, size), wanted in sorted(GOAL_GPU.items(), key=lambda item: (ORDER.index(item[0][0]), item[0][1])):
        row = find(rows, scene=scene, size=size, shading='none')
        verdict = SOFTWARE if backend != 'gl' else met(row['fps'] >= wanted) if row else 'not measured'
        lines.append([scene, size, wanted, short(row['fps']) if row else '–', verdict])
    return table(['scene', 'px', 'goal, frames a second', 'fps', 'on this device'], lines)


GPU_EXPLAINED = '''Stages are shares of a mean frame that is drawn alone, by the GPU's stamps (`classify` is the processor's: lists, and what is drawn of them); `read` is the GPU's copy of the picture to where the processor sees it, and the processor's from there. The rest is
what no stage accounts for: cutting batches, handing the work over, and waiting. With two in flight the next frame is begun before the one before is read (–: left out).

The model of a frame, for the fractions of memory bandwidth and arithmetic: 52 bytes and 120 operations a splat (its voxel's word, the record and its tiles written, the tiles read again),
40 bytes a pair of a splat and a tile (its number written and read, the record read), 11 operations a pair and pixel of the tile, 16 more a fragment, and 76 bytes a pixel (cleared, composited, resolved, copied twice). Pairs are
those of the mean footprint. Tables, counts and gradients are left out, and opaque tiles do less. `deploy/bench.sh --gpu-peak GB/s,TFLOP/s` says what the device can do.
'''


def left_out(rows):
    """A sentence on what took too long; '' if nothing did."""
    sizes = {}
    for r in rows:
        if r.get('left_out'):
            sizes.setdefault((r['scene'] + (', shaded' if r['shading'] == 'phong' else ''), r['left_out']), []).append(f'{r["size"]:.0f}')
    names = [f'{scene} at {", ".join(px)} px ({why})' for (scene, why), px in sizes.items()]
    return f'Left out: {"; ".join(names)}.\n\n' if names else ''


def gpu_line(r):
    work = gpu_work(r['splats'], r['fragments'], r['size'] ** 2)
    return [r['scene'], f'{r["size"]:.0f}', 'shaded' if r['shading'] == 'phong' else '', short(r['splats'] / 1e6), short(r['median_ms']),
            short(r['fps']), short(r.get('in_flight_2_fps')), short(r['splats_per_second'] / 1e6),
            *(f'{100 * (r.get(s) or 0) / r["mean_ms"]:.0f} %' for s in GPU_STAGES),
            f'{short(r["fps"] / r["cpu_fps"], 2)}' if r['cpu_fps'] else '–', short(work[0] / 1e6), short(work[1] / 1e9), *gpu_shares(r, work)]


def gpu_edits(folder):
    rows = ordered(read(folder, 'gl_edits.csv'))
    text = edit_table([r for r in rows if not r['left_out']])
    text += ''.join(f'\n{r["scene"]}, {r["setting"].split("=")[1]}: left out, {r["left_out"]}.\n' for r in rows if r['left_out'])
    return text and '\nA transfer function that changes at every frame, 512 × 512, in turns with a fixed one:\n\n' + text


GPU_STAGES = ('classify_ms', 'splat_ms', 'bin_ms', 'tile_ms', 'resolve_ms', 'read_ms', 'rest_ms')
GPU_HEAD = ['scene', 'px', '', 'Msplat drawn', 'median ms', 'fps', 'fps, two in flight', 'Msplat/s', *(s[:-3] for s in GPU_STAGES), 'times the CPU backend',
            'model MB', 'model Gop', 'of bandwidth', 'of arithmetic']


def gpu(folder):
    rows = ordered(read(folder, 'gl.csv'))
    if not rows:
        return ''
    drawn = [r for r in rows if not r.get('left_out')]
    about = f'Device: {rows[0]["device"]}. Backend `{rows[0]["backend"]}`, {rows[0]["views"]:.0f} views.'
    if rows[0]['backend'] != 'gl':
        about += f' Its times say nothing about a GPU, nor do the shares of the stages: {SOFTWARE}.'
    return (f'{about}\n\n{table(GPU_HEAD, [gpu_line(r) for r in drawn])}\n{left_out(rows)}{GPU_EXPLAINED}\nGoals on a data-centre GPU, not shaded:\n\n'
            f'{gpu_goals(rows[0]["backend"], drawn)}{gpu_edits(folder)}')


SERVE_HEADS = {
    'what': '', 'clients': 'clients', 'px': 'px asked for', 'side': 'side drawn', 'coarse': 'coarse', 'fps_min': 'fps, least', 'fps_mean': 'fps, mean',
    'p50_ms': 'median ms', 'p95_ms': 'p95 ms', 'p99_ms': 'p99 ms', 'kbytes_frame': 'kB a frame', 'rss_mib': 'MiB of the daemon',
    'cpu_share': 'cores in use', 'change_percent': 'change, %', 'alone_fps': 'fps, alone', 'alone_p95_ms': 'p95 ms, alone', 'kib_each': 'KiB each',
    'held': 'held', 'refused': 'refused', 'cpu_ms_frame': 'CPU ms a frame', 'cpu_rest_percent': 'CPU % at rest', 'note': '',
}
BESIDE = ('what', 'alone_fps', 'fps_mean', 'change_percent', 'alone_p95_ms', 'p95_ms', 'side', 'cpu_share')
SERVE_TABLES = [  # part, its columns, and what they are
    ('overhead', ('what', 'px', 'side', 'fps_mean', 'p50_ms', 'p95_ms', 'p99_ms', 'kbytes_frame', 'cpu_share'), 'One user, and nothing to render.'),
    ('awake', ('clients', 'what', 'fps_mean', 'p95_ms', 'cpu_ms_frame', 'cpu_rest_percent', 'rss_mib'),
     'One user who moves, and nothing to render, beside others who look at sessions of their own that do nothing; and all when nobody moves.'),
    ('viewers', ('clients', 'what', 'side', 'coarse', 'fps_min', 'fps_mean', 'kbytes_frame', 'rss_mib', 'cpu_share'), 'Those who look at one shared view.'),
    ('sessions', ('clients', 'what', 'side', 'coarse', 'fps_min', 'fps_mean', 'p50_ms', 'p95_ms', 'p99_ms', 'kbytes_frame', 'rss_mib', 'cpu_share'),
     'Those who turn a view each, 512 px asked for. `side drawn` is the root of the mean picture\'s pixels; `coarse` n: 2ⁿ×2ⁿ×2ⁿ voxels were drawn as one, in the mean.'),
    ('memory', ('what', 'clients', 'rss_mib', 'kib_each', 'note'), 'What each of 32 further ones took, all turning.'),
    ('hostile', (*BESIDE, 'verdict', 'note'), 'One user at 512 px, alone and beside one client of each temper, in turns; medians, and the change of the frame rate in each round.'),
    ('beside', (*BESIDE, 'note'), 'The same beside what is nobody\'s ill will.'),
    ('idle', ('what', 'held', 'refused', 'kib_each', 'alone_fps', 'fps_mean', 'change_percent', 'alone_p95_ms', 'p95_ms', 'verdict'),
     'One user beside connections that say nothing.'),
]
SOAK_HEADS = {'minute': 'minute', 'clients': 'clients so far', 'errands': 'errands so far', 'sessions': 'sessions', 'rss_mib': 'MiB of the daemon', 'descriptors': 'descriptors', 'failed': 'refused or failed'}


def is_fair(row):
    return row['change_percent'] >= -GOAL_DISTURBED


def is_as_configured(row):
    """Of idle connections: held up to the limit, a few more that are being told so, and the rest refused."""
    within = min(row['wanted'], row['limit'])
    return within * (1 - IDLE_SLACK) <= row['held'] <= within * (1 + IDLE_SLACK) and (row['refused'] > 0) == (row['wanted'] > row['limit'])


def serve_cell(row, key):
    if key == 'verdict':
        return met(is_fair(row) if row['part'] == 'hostile' else is_as_configured(row))
    if key == 'change_percent' and row[key] != '':
        return f'{row[key]:+.1f}'
    if key in ('what', 'note'):
        return row[key]
    return f'{row[key]:.0f}' if key in ('clients', 'px', 'side', 'held', 'refused') and row[key] != '' else short(row[key])


def flat_memory(soak):
    """Of a soak: by how many percent memory grew in its second half, and whether descriptors did at all."""
    half = (len(soak) - 1) // 2
    return (100 * (soak[-1]['rss_mib'] / soak[half]['rss_mib'] - 1),
            max(r['descriptors'] for r in soak[half + 1:]) <= 1 + max(r['descriptors'] for r in soak[:half + 1]))


def serve_goals(rows, soak):
    """What was wanted of the daemon, and what was found."""
    parts = {part: [r for r in rows if r['part'] == part] for part, _, _ in SERVE_TABLES}
    lines = [[f'{r["px"]:.0f} × {r["px"]:.0f}, overhead, p95', f'{GOAL_OVERHEAD_MS} ms', f'{short(r["p95_ms"])} ms', met(r['p95_ms'] <= GOAL_OVERHEAD_MS)]
             for r in parts['overhead'] if r['px'] == 1024]
    if parts['viewers']:
        most = max((r['clients'] for r in parts['viewers'] if r['fps_min'] >= GOAL_USER_FPS), default=0)
        lines.append(['viewers of one shared view', f'{GOAL_USER_FPS} fps each', f'{most:.0f}', met(all(r['fps_min'] >= GOAL_USER_FPS for r in parts['viewers']))])
    whole = [r for r in parts['sessions'] if r['what'].startswith('full')]
    if whole:
        most = max((r['clients'] for r in whole if r['fps_min'] >= GOAL_USER_FPS), default=0)
        lines.append(['most independent sessions at full 512 × 512', f'{GOAL_USER_FPS} fps each', f'{most:.0f}', met(most > 0)])
    for r in parts['memory']:
        wanted = GOAL_VIEWER_MIB if 'viewer' in r['what'] else GOAL_SESSION_MIB
        lines.append([f'memory of {r["what"]}', f'{wanted} MiB', f'{short(r["kib_each"] / 1024)} MiB', met(r['kib_each'] <= 1024 * wanted)])
    if parts['hostile']:
        worst = min(parts['hostile'], key=lambda r: r['change_percent'])
        fair = sum(map(is_fair, parts['hostile']))
        lines.append([f'frames lost beside one hostile client; {fair} of {len(parts["hostile"])} tempers are within the goal', f'{GOAL_DISTURBED} %',
                      f'{-worst["change_percent"]:.1f} % at worst ({worst["what"]})', met(is_fair(worst))])
    lines += [[r['what'], 'held or refused as configured', f'{r["held"]:.0f} held, {r["refused"]:.0f} refused', met(is_as_configured(r))] for r in parts['idle']]
    if len(soak) > 1:
        grown, steady = flat_memory(soak)
        lines.append([f'memory in the second half of a soak of {soak[-1]["minute"]:.0f} minutes', f'{GOAL_GROWTH} % more', f'{grown:.1f} % more', met(grown <= GOAL_GROWTH)])
        lines.append(['descriptors then', 'no more than before', 'so' if steady else 'more', met(steady)])
    return table(['', 'goal', 'measured', ''], lines)


def serve(folder):
    rows, soak = read(folder, 'serve.csv'), read(folder, 'soak.csv')
    volumes = sorted({r['volume'] for r in rows})
    texts = [serve_goals(rows, soak), volumes and f'The users\' volume is {", ".join(volumes)}.\n']
    for part, keys, explained in SERVE_TABLES:
        lines = [[serve_cell(r, key) for key in keys] for r in rows if r['part'] == part]
        heads = [{**SERVE_HEADS, 'verdict': f'goal {GOAL_DISTURBED} %' if part == 'hostile' else 'as configured'}[key] for key in keys]
        texts.append(lines and f'### {part.capitalize()}\n\n{explained}\n\n{table(heads, lines)}')
    lines = [[short(r[key], 4) for key in SOAK_HEADS] for r in soak]
    texts.append(lines and '### Soak\n\nTwelve people at a time, who come and go, each with a session of its own at 256 × 256, a third of them with somebody who looks on, in JPEG, WebP, PNG, VP8 or VP9 '
                 'as they choose; a JPEG by HTTP every 100 ms; and errands, one after the other: a kept view, its picture in any format, and away with it; a volume that is loaded, drawn and unloaded; a camera '
                 f'path of 12 frames as a movie. With `--state`.\n\n{table(SOAK_HEADS.values(), lines)}')
    return '\n'.join(text for text in texts if text)


def codecs(folder):
    rows, lines = read(folder, 'codecs.csv'), []
    for r in rows:
        plain = find(rows, scene=r['scene'], size=r['size'], codec='jpeg 4:2:0', quality=r['quality'])
        lines.append([r['scene'], f'{r["size"]:.0f}', r['codec'], f'{r["quality"]:.0f}', *(short(r[k] / 1000) for k in ('key_bytes', 'bytes')), short(r['ms']), short(r['cpu_ms']),
                      *(short(r[k] / plain[k], 2) if plain else '–' for k in ('bytes', 'cpu_ms'))])
    return table(['volume', 'px', 'codec', 'quality', 'kB, first frame', 'kB, later ones', 'ms', 'CPU ms', 'bytes, of JPEG 4:2:0', 'CPU, of JPEG 4:2:0'], lines)


def acceptor(folder):
    lines = [[r['what'], short(r['median_ms']), short(r['slowest_ms']), f'{GOAL_ECHO_MS}: {met(r["slowest_ms"] < GOAL_ECHO_MS)}' if 'echo' in r['what'] else '–']
             for r in read(folder, 'tls.csv')]
    return table(['', 'median ms', 'slowest ms', 'goal, ms'], lines)


def threads(folder):
    rows = [r for r in read(folder, 'scenes.csv') if r['renderer'] == 'splatd' and r['threads'] == 1]
    lines = []
    for one in ordered(rows):
        two = find(read(folder, 'scenes.csv'), renderer='splatd', scene=one['scene'], size=one['size'], shading=one['shading'], threads=2)
        if two and one['shading'] == 'none':
            lines.append([one['scene'], f'{one["size"]:.0f}', short(one['median_ms']), short(two['median_ms']),
                          f'{one["median_ms"] / two["median_ms"]:.2f}'])
    return table(['scene', 'px', 'one thread ms', 'two ms', 'times'], lines)


def cancel(folder):
    rows = ordered(read(folder, 'cancel.csv'))
    lines = [[r['scene'], r['what'], f'{r["stopped"]:.0f}', short(r['range_ms']), short(r['median_ms']), short(r['worst_ms']),
              met(r['worst_ms'] <= GOAL_CANCEL_MS) if r['stopped'] else '–'] for r in rows]
    return table(['scene', 'what is cancelled', 'times', 'frame ms', 'median ms', 'worst ms', f'goal {GOAL_CANCEL_MS} ms'], lines)


def memory(folder):
    rows = [r for r in read(folder, 'scenes.csv') if r['renderer'] == 'splatd']
    lines = []
    for scene in [s for s in ORDER if any(r['scene'] == s for r in rows)]:
        own = [r for r in rows if r['scene'] == scene]
        plain, shaded = ([r for r in own if r['shading'] == shading] for shading in ('none', 'phong'))
        most = max(r['derived_per_voxel'] for r in own)
        lines.append([scene, millions(own[0]['voxels']), *(f'{max((r["derived_per_voxel"] for r in kind), default=0):.2f}' for kind in (plain, shaded)),
                      met(most <= GOAL_BYTES), short(max(r['allocations'] for r in own))])
    return table(['scene', 'Mvoxel', 'derived bytes a voxel', 'shaded', f'goal {GOAL_BYTES}', 'allocations a frame, most'], lines)


def headline(folder):
    """Lines for the project's README: two threads, 512 px, not shaded."""
    rows = read(folder, 'scenes.csv')
    lines, ratios = [], []
    for own in ordered([r for r in rows if (r['renderer'], r['size'], r['threads'], r['shading']) == ('splatd', 512, 2, 'none')]):
        vtk = find(rows, renderer='vtk', scene=own['scene'], size=512, threads=2, shading='none')
        parts = [f'{short(own["fps"], 2)} frames a second']
        if vtk:
            ratios.append(own['fps'] / vtk['fps'])
            parts.append(f'{ratios[-1]:.1f} times VTK\'s CPU ray caster')
        parts += [f'{own["fps"] / fps:.0f} times {source}' for fps, source in PAPERS.get(own['scene'], [])]
        lines.append(f'- {own["scene"]}, {millions(own["splats"])} million splats: ' + ', '.join(parts))
    if ratios:
        lines.insert(0, f'- {min(ratios):.1f} to {max(ratios):.1f} times VTK\'s CPU ray caster at 512 × 512 on two threads')
    return '\n'.join(lines) + '\n' if lines else ''


SECTIONS = [
    ('Headline', headline, 'At 512 × 512, two threads, not shaded.'),
    ('Scenes', scenes, 'Medians over an orbit. "Times scalar" is the instruction set against the scalar reference of the same run.'),
    ('Where the time goes', profile, 'Shares of the stages; fragments are the area of the footprints drawn. The limit handles each splat '
     'on its own, at the best rates below; above 100 % a frame does less than that work.'),
    ('The limit', limit, 'Adding footprints of a width to a tile in the nearest cache, and setting them up: million splats a second, all threads '
     'together. Memory beside it.'),
    ('Adaptive against ewa', adaptive, '512 × 512, two threads, the two in turns.'),
    ('Level of detail', detail, '512 × 512, two threads, `auto` and `off` in turns.'),
    ('A transfer function that changes at every frame', edits, '512 × 512, two threads, in turns with a fixed one.'),
    ('Scaling with the volume', scaling, 'The balls of `demo:sparse` at 512 × 512, level of detail `auto` and `off`; memory is of both.'),
    ('One and two threads', threads, ''),
    ('Cancelling', cancel, '1024 × 1024, two threads: from setting the flag, at a random moment of the frame, to the return of the call.'),
    ('The GPU backend', gpu, ''),
    ('Memory', memory, 'What is kept beside the samples, and how often a frame asks for memory once the first ones are drawn.'),
    ('What the daemon costs', serve, 'By `serve.mjs`; its clients share the machine with the daemon, and their work is in every figure. Milliseconds are from a change of the view to its '
     'picture. Goals are limits.'),
    ('Codecs', codecs, 'The camera turns by 2° a frame; CPU time is of all threads. Qualities are nominal: what the pictures lose was not compared.'),
    ('TLS', acceptor, 'The acceptor alone, on this machine.'),
]


def page(folder):
    about = {r['key']: r['value'] for r in read(folder, 'machine.csv')}
    parts = ['# What the bench measured\n', 'Made by `tests/bench/report.py` from the CSV files beside it; `deploy/bench.sh` measures them again. '
             'Absolute figures belong to this machine; ratios were taken in one run.\n',
             table(['', ''], [[k, f'{v:g}' if isinstance(v, float) else v] for k, v in about.items()])]
    notes = os.path.join(folder, 'notes.md')
    for title, make, explained in SECTIONS:
        body = make(folder)
        if not body:
            continue
        parts.append(f'## {title}\n\n' + (explained + '\n\n' if explained else '') + body)
        if make is profile and os.path.exists(notes):
            with open(notes, encoding='utf-8') as f:
                parts.append(f.read())
        parts += [f'![{title}]({name})\n' for name in draw(folder, make)]
    return '\n'.join(parts)


def draw(folder, make):
    """The chart of a section, if it has one: its file's name."""
    if make is headline:
        rows = read(folder, 'scenes.csv')
        own = ordered([r for r in rows if (r['renderer'], r['size'], r['threads'], r['shading']) == ('splatd', 512, 2, 'none')])
        groups = []
        for r in own:
            vtk = find(rows, renderer='vtk', scene=r['scene'], size=512, threads=2, shading='none')
            groups.append((r['scene'], [r['fps'], vtk['fps'] if vtk else None, max((f for f, _ in PAPERS.get(r['scene'], [])), default=None)]))
        svg = charts.bars('Frames a second, 512 × 512, two threads', ('splatd', 'VTK', 'papers, their cards'), groups)
        name = 'scenes.svg'
    elif make is scaling:
        rows = [r for r in read(folder, 'scaling.csv') if r['threads'] == 2]
        svg = charts.lines('Milliseconds a frame, 512 × 512, two threads', ('level of detail auto', 'off'),
                           [[(r['volume_size'], r[k]) for r in rows] for k in ('auto_ms', 'off_ms')], 'voxels a side')
        name = 'scaling.svg'
    else:
        return []
    if not svg:
        return []
    with open(os.path.join(folder, name), 'w', encoding='utf-8') as f:
        f.write(svg)
    return [name]


def main():
    if len(sys.argv) != 2 or not os.path.isdir(sys.argv[1]):
        sys.stderr.write('usage: report.py DIR\n')
        return 2
    folder = sys.argv[1]
    if not read(folder, 'scenes.csv'):
        sys.stderr.write(f'report.py: {folder} has no scenes.csv: run deploy/bench.sh first\n')
        return 1
    text = page(folder)
    with open(os.path.join(folder, 'README.md'), 'w', encoding='utf-8') as f:
        f.write(text)
    sys.stdout.write(headline(folder))
    return 0


if __name__ == '__main__':
    sys.exit(main())
