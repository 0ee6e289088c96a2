#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes the page of benchmark results: report.py DIR reads DIR/*.csv and writes DIR/README.md and two charts.

The page holds headline tables only; the CSV files hold every measurement. A table whose file is missing is left
out. notes.md in the same folder, if present, is copied into the page: it holds the findings that no program can
write. The speed headline is also printed.
"""
import math
import os
import re
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import charts  # noqa: E402
from brick_goals import bricks, GOAL_COMPLETE_MS, GOAL_LOAD_MS  # noqa: E402
from element_goals import drag_goals, element_goals  # noqa: E402
from tables import decibels, met, read, short, table  # noqa: E402

# Frames per second at 512 × 512 as the papers print them for their own graphics cards (Chen et al.: 2.4 GHz Pentium 4
# with an ATI 9800 Pro; Botha and Post: 1.2 GHz Athlon with a GeForce3).
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
# Chen et al., table 3: the speed gain of adaptive over ewa, in percent.
CHEN_ADAPTIVE = {'engine': 12, 'bonsai': 9, 'lobster': 21, 'head': 11}
GOAL, GOAL_SPARSE, SPARSE = 5, 10, ('engine', 'bonsai', 'lobster', 'aneurism')
GOAL_PIXELS, GOAL_PIXELS_SPARSE = 5, 10  # times VTK, sheets per pixel
GOAL_FPS = {'head-full': 40}  # at 512 px, two threads, unshaded
GOAL_ADAPTIVE_DB, GOAL_DETAIL_DB, GOAL_EDIT, GOAL_CANCEL_MS, GOAL_BYTES = 45, 40, 0.90, 5, 2
# Goals of the daemon; GOAL_DISTURBED and GOAL_GROWTH are percentages.
GOAL_WAIT_MS, GOAL_REQUEST_MS = (4, 14), 3  # beside rendering and encoding: median and p95; p95
GOAL_OVERHEAD_MS, GOAL_USER_FPS, GOAL_VIEWER_MIB, GOAL_SESSION_MIB, GOAL_DISTURBED, GOAL_GROWTH, GOAL_ECHO_MS = 5, 10, 2, 16, 5, 5, 200
# The daemon keeps a few connections above its limit open while it tells their clients that it is full.
IDLE_SLACK = 0.1
# Goals on a data-centre GPU, in frames per second, unshaded, by (scene, px).
GOAL_GPU = {(scene, 512): 1000 for scene, found in PAPERS.items() if {CHEN_3, CHEN_4} & {source for _, source in found}}
GOAL_GPU.update({('head-full', 512): 500, ('sparse', 1024): 200})
SOFTWARE = 'software GL, for correctness only'
ORDER = ('engine', 'bonsai', 'bonsai-full', 'lobster', 'head', 'head-full', 'aneurism', 'checkerboard', 'sparse', 'bonsai-soft', 'turbulence', 'noise')
WITHOUT_GOAL = ORDER[-3:]  # no voxel is transparent


def ordered(rows):
    return sorted(rows, key=lambda r: ORDER.index(r['scene']) if r['scene'] in ORDER else len(ORDER))


def find(rows, **wanted):
    return next((r for r in rows if all(r[k] == v for k, v in wanted.items())), None)


def goal(scene):
    return GOAL_SPARSE if scene in SPARSE else GOAL


def against_vtk(rows, own):
    """Frames per second and the ratio to VTK at the same setting, None where VTK was not measured."""
    if not own:
        return None, None
    vtk = find(rows, renderer='vtk', **{k: own[k] for k in ('scene', 'size', 'threads', 'shading')})
    return own['fps'], own['fps'] / vtk['fps'] if vtk else None


def speed_cell(fps, ratio):
    if fps is None:
        return '–'
    return f'{short(fps)} ({ratio:.1f}×)' if ratio else short(fps)


SPEED_HEAD = ['scene', 'million splats', '512², unshaded', '512², shaded', '1024², unshaded', '1024², shaded', 'goal at 512²',
              'of the papers\' cards']


def scenes(folder):
    """Frames per second with two threads, and the ratio to VTK, one row per scene."""
    rows = read(folder, 'scenes.csv')
    lines = []
    for first in ordered([r for r in rows if (r['renderer'], r['size'], r['threads'], r['shading']) == ('splatd', 512, 2, 'none')]):
        scene = first['scene']
        found = [against_vtk(rows, find(rows, renderer='splatd', scene=scene, size=size, threads=2, shading=shading))
                 for size in (512, 1024) for shading in ('none', 'phong')]
        fps, ratio = found[0]
        verdict = '–' if scene in WITHOUT_GOAL else f'{goal(scene)}×: {met(ratio >= goal(scene)) if ratio else "–"}'
        if scene in GOAL_FPS:
            verdict += f', {GOAL_FPS[scene]} fps: {met(fps >= GOAL_FPS[scene])}'
        lines.append([scene, short(first['splats'] / 1e6), *(speed_cell(*pair) for pair in found), verdict,
                      ', '.join(f'{fps / theirs:.0f}× {source.split()[0]}' for theirs, source in PAPERS.get(scene, [])) or '–'])
    return table(SPEED_HEAD, lines)


PIXELS_HEAD = ['scene', '512², unshaded', '512², shaded', '1024², unshaded', '1024², shaded', 'goal']


def pixels(folder):
    """The same for sheets that are classified per pixel."""
    rows = read(folder, 'pixels.csv')
    lines = []
    for first in ordered([r for r in rows if (r['renderer'], r['size'], r['shading']) == ('splatd', 512, 'none')]):
        scene = first['scene']
        found = [against_vtk(rows, find(rows, renderer='splatd', scene=scene, size=size, shading=shading))
                 for size in (512, 1024) for shading in ('none', 'phong')]
        wanted = GOAL_PIXELS_SPARSE if scene in SPARSE else GOAL_PIXELS
        ratios = [ratio for _, ratio in found if ratio]
        lines.append([scene, *(speed_cell(*pair) for pair in found), f'{wanted}×: {met(min(ratios) >= wanted) if ratios else "–"}'])
    return table(PIXELS_HEAD, lines) if lines else ''


def pair_goals(folder):
    """Adaptive filtering and level of detail against their references."""
    lines = []
    rows = read(folder, 'adaptive.csv')
    if rows:
        worst = min(r['psnr_worst_db'] for r in rows)
        gains = {r['scene']: 100 * (r['speedup'] - 1) for r in rows if r['zoom'] == 1}
        lines += [[f'{scene}: adaptive faster than ewa', f'{wanted} % (Chen et al., table 3)', f'{gains[scene]:.0f} %', met(gains[scene] >= wanted),
                   'adaptive.csv'] for scene, wanted in CHEN_ADAPTIVE.items() if scene in gains]
        lines.append(['adaptive against ewa, worst view', f'{GOAL_ADAPTIVE_DB} dB', decibels(worst), met(worst >= GOAL_ADAPTIVE_DB), 'adaptive.csv'])
    rows = read(folder, 'detail.csv')
    if rows:
        worst = min(r['psnr_worst_db'] for r in rows)
        lines.append(['level of detail against all voxels, worst view', f'{GOAL_DETAIL_DB} dB', decibels(worst), met(worst >= GOAL_DETAIL_DB), 'detail.csv'])
    return lines


def edit_goals(folder, file, backend=''):
    rows = [r for r in read(folder, file) if not r.get('left_out')]
    if not rows:
        return []
    worst = min(rows, key=lambda r: r['speedup'])
    verdict = SOFTWARE if worst.get('backend') == 'gl-software' else met(worst['speedup'] >= GOAL_EDIT)
    return [[f'frame rate while the transfer function changes{backend}, relative to a fixed one', f'{100 * GOAL_EDIT:.0f} %',
             f'{100 * worst["speedup"]:.0f} % at worst ({worst["scene"]}, {worst["setting"].split("=")[1]})', verdict, file]]


def other_goals(folder):
    lines = []
    rows = [r for r in read(folder, 'cancel.csv') if r['stopped']]
    if rows:
        worst = max(rows, key=lambda r: r['worst_ms'])
        lines.append(['cancelling a frame at 1024²', f'{GOAL_CANCEL_MS} ms', f'{short(worst["worst_ms"])} ms at worst ({worst["scene"]})',
                      met(worst['worst_ms'] <= GOAL_CANCEL_MS), 'cancel.csv'])
    rows = [r for r in read(folder, 'scenes.csv') if r['renderer'] == 'splatd']
    if rows:
        worst = max(rows, key=lambda r: r['derived_per_voxel'])
        lines.append(['cached bytes per voxel, beside the samples', f'{GOAL_BYTES}', f'{worst["derived_per_voxel"]:.2f} at worst ({worst["scene"]})',
                      met(worst['derived_per_voxel'] <= GOAL_BYTES), 'scenes.csv'])
    gains = thread_gains(rows)
    if gains:
        lines.append(['two threads against one', 'none', f'{min(gains):.2f}× to {max(gains):.2f}×', '–', 'scenes.csv'])
    rows = read(folder, 'scaling.csv')
    if rows:
        last = max(rows, key=lambda r: (r['volume_size'], r['threads']))
        lines.append([f'`demo:sparse` with {last["volume_size"]:.0f}³ voxels at 512²', 'none', f'{short(last["auto_ms"])} ms per frame', '–', 'scaling.csv'])
    for r in read(folder, 'tls.csv'):
        if 'echo' in r['what']:
            lines.append([f'TLS, {r["what"]}, slowest', f'{GOAL_ECHO_MS} ms', f'{short(r["slowest_ms"])} ms', met(r['slowest_ms'] < GOAL_ECHO_MS), 'tls.csv'])
    return lines


def thread_gains(rows):
    """Ratios of one thread's time to two threads' time, unshaded."""
    gains = []
    for one in rows:
        if one['threads'] == 1 and one['shading'] == 'none':
            two = find(rows, scene=one['scene'], size=one['size'], shading='none', threads=2)
            gains += [one['median_ms'] / two['median_ms']] if two else []
    return gains


GOAL_HEAD = ['what', 'goal', 'measured', '', 'file']


def goals(folder):
    return table(GOAL_HEAD, pair_goals(folder) + edit_goals(folder, 'edits.csv') + other_goals(folder))


def add_cost(rates, area):
    """Seconds to add one footprint of `area` pixels at best, interpolated from the table of widths; rates in Msplat/s."""
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
    """The best rates of all instruction sets, per width and for the setup; None if they were not measured."""
    rows = [r for r in read(folder, 'limit.csv') if r['threads'] == threads]
    if not rows:
        return None
    return {width: max(r[f'add_{width}'] for r in rows) for width in (3, 5, 7, 11)}, max(r['set_up'] for r in rows)


def limit_ms(limits, splats, fragments):
    rates, set_up = limits
    return splats * (add_cost(rates, fragments / splats) + 1e-6 / set_up) * 1e3 if splats else 0


def profile(folder):
    """Where the time of unshaded frames goes."""
    rows = ordered([r for r in read(folder, 'profile.csv') if r['shading'] == 'none'])
    if not rows:
        return ''
    stages = [k for k in rows[0] if k.endswith('_ms') and k not in ('median_ms', 'mean_ms')]
    lines = []
    for r in rows:
        total = sum(r[s] or 0 for s in stages) or 1
        limits = best_limits(folder, r['threads'])
        lines.append([r['scene'], short(r['median_ms'])] + [f'{100 * (r[s] or 0) / total:.0f} %' for s in stages] +
                     [short(r['splats'] / r['median_ms'] / 1e3), short(r['fragments'] / r['splats']) if r['splats'] else '–',
                      f'{100 * limit_ms(limits, r["splats"], r["fragments"]) / r["median_ms"]:.0f} %' if limits else '–'])
    return table(['scene', 'median ms'] + [s[:-3] for s in stages] + ['Msplat/s', 'px per splat', 'of the limit'], lines)


GPU_TILE = 8  # px, as in backend/gl/program.h


def gpu_work(splats, fragments, pixels):
    """Bytes and operations of a frame by a model.

    Per splat 52 bytes and 120 operations (read its voxel, write the record and its tiles, read the tiles again). Per
    pair of a splat and a tile 40 bytes (write and read its index, read the record) and 11 operations per pixel of the
    tile. Per fragment 16 operations. Per pixel 76 bytes (clear, composite, resolve, two copies).
    """
    side = math.sqrt(4 / math.pi * fragments / splats) if splats else 0
    pairs = splats * (1 + side / GPU_TILE) ** 2
    return splats * 52 + pairs * 40 + pixels * 76, splats * 120 + pairs * GPU_TILE ** 2 * 11 + fragments * 16


def gpu_shares(row):
    """Fractions of the device's memory bandwidth and arithmetic, where bench.sh was given both."""
    if row['backend'] != 'gl' or not row['peak_gb_s']:
        return ['–', '–']
    amounts = gpu_work(row['splats'], row['fragments'], row['size'] ** 2)
    seconds = row['median_ms'] / 1e3
    return [f'{100 * amount / seconds / (peak * unit):.1f} %'
            for amount, peak, unit in zip(amounts, (row['peak_gb_s'], row['peak_tflop_s']), (1e9, 1e12))]


def vtk_rates(plain, shaded):
    """Unshaded, and shaded where that is what stands beside it."""
    return ', '.join(short(row['fps']) + ' shaded' * (row is shaded) for row in (plain, shaded) if row) or '–'


def gpu(folder):
    rows = ordered(read(folder, 'gl.csv'))
    if not rows:
        return ''
    drawn = [r for r in rows if not r.get('left_out')]
    about = f'Device: {rows[0]["device"]}. Backend `{rows[0]["backend"]}`, {rows[0]["views"]:.0f} views, unshaded.'
    if rows[0]['backend'] != 'gl':
        about += f' Its times say nothing about a GPU: {SOFTWARE}.'
    lines = []
    for (scene, size), wanted in sorted(GOAL_GPU.items(), key=lambda item: (ORDER.index(item[0][0]), item[0][1])):
        row = find(drawn, scene=scene, size=size, shading='none')
        pixels, peer = (find(read(folder, name), scene=scene, size=size, shading='none') for name in ('gl_pixels.csv', 'gl_vtk.csv'))
        shaded = None if pixels else find(read(folder, 'gl_pixels.csv'), scene=scene, size=size, shading='phong')
        pixels = pixels or shaded
        rates = [row['fps'], row['in_flight_2_fps'] or 0] if row else []
        rates += [pixels['fps']] if pixels else []
        verdict = SOFTWARE if rows[0]['backend'] != 'gl' else met(max(rates) >= wanted) if rates else 'not measured'
        lines.append([scene, size, wanted, short(row['fps']) if row else '–', short(row['in_flight_2_fps']) if row else '–', short(pixels['fps']) + ' shaded' * bool(shaded) if pixels else '–',
                      vtk_rates(peer, shaded and find(read(folder, 'gl_vtk.csv'), scene=scene, size=size, shading='phong')), *(gpu_shares(row) if row else ['–', '–']), verdict])
    left_out = sorted({f'{r["scene"]} at {r["size"]:.0f} px' for r in rows if r.get('left_out')})
    text = f'{about}\n\n' + table(['scene', 'px', 'goal, fps', 'per voxel', 'two frames in flight', 'per pixel, two in flight', 'VTK on this GPU', 'of memory bandwidth',
                                    'of arithmetic', ''], lines)
    if left_out:
        text += f'\nNot measured, because a frame takes too long: {"; ".join(left_out)}.\n'
    streams = [[f'{r["clients"]:.0f}', f'{r["side"]:.0f}', short(r['fps_mean']), short(r['p50_ms']), short(r['p95_ms']), short(r['work_ms']), short(r['cpu_ms_frame'])]
               for r in read(folder, 'gl_streams.csv')]
    if streams:
        text += '\nSessions of 1024² that turn at 60 changes per second on the same device; with many the daemon draws smaller images while they move:\n\n'
        text += table(['sessions', 'px', 'fps each', 'latency p50, ms', 'p95, ms', 'rendering and encoding, ms', 'CPU per frame, ms'], streams)
    edits = edit_goals(folder, 'gl_edits.csv', ' on this device')
    text += f'\n{table(GOAL_HEAD, edits)}' if edits else ''
    others = element_table(folder, 'gl_elements.csv')
    return text + (f'\nPoints, Gaussians, triangles and vectors at 512² on the same device{", for correctness only" * (rows[0]["backend"] != "gl")}:\n\n{others}' if others else '')


def is_fair(row):
    return row['change_percent'] >= -GOAL_DISTURBED


def is_as_configured(row):
    """Idle connections: the daemon holds them up to its limit, a few more that it is about to refuse, and refuses the rest."""
    within = min(row['wanted'], row['limit'])
    return within * (1 - IDLE_SLACK) <= row['held'] <= within * (1 + IDLE_SLACK) and (row['refused'] > 0) == (row['wanted'] > row['limit'])


def flat_memory(soak):
    """Memory growth in the second half of a soak, in percent, and whether the number of descriptors stayed."""
    half = (len(soak) - 1) // 2
    return (100 * (soak[-1]['rss_mib'] / soak[half]['rss_mib'] - 1),
            max(r['descriptors'] for r in soak[half + 1:]) <= 1 + max(r['descriptors'] for r in soak[:half + 1]))


def serve_goals(rows, soak):
    """Goals of the daemon and what was measured."""
    def part(name):
        return [r for r in rows if r['part'] == name]
    lines = [[f'overhead of a frame at {r["px"]:.0f}² without rendering, p95', f'{GOAL_OVERHEAD_MS} ms', f'{short(r["p95_ms"])} ms', met(r['p95_ms'] <= GOAL_OVERHEAD_MS)]
             for r in part('overhead') if r['px'] == 1024]
    viewers = part('viewers')
    if viewers:
        most = max((r['clients'] for r in viewers if r['fps_min'] >= GOAL_USER_FPS), default=0)
        lines.append([f'number of viewers of one shared view that get {GOAL_USER_FPS} fps each', 'all', f'{most:.0f}', met(all(r['fps_min'] >= GOAL_USER_FPS for r in viewers))])
    whole = [r for r in part('sessions') if r['what'].startswith('full')]
    if whole:
        most = max((r['clients'] for r in whole if r['fps_min'] >= GOAL_USER_FPS), default=0)
        lines.append([f'number of sessions at full 512² detail that get {GOAL_USER_FPS} fps each', 'at least 1', f'{most:.0f}', met(most > 0)])
    for r in part('memory'):
        wanted = GOAL_VIEWER_MIB if 'viewer' in r['what'] else GOAL_SESSION_MIB
        lines.append([f'memory of {r["what"]}', f'{wanted} MiB', f'{short(r["kib_each"] / 1024)} MiB', met(r['kib_each'] <= 1024 * wanted)])
    hostile = part('hostile')
    if hostile:
        worst = min(hostile, key=lambda r: r['change_percent'])
        lines.append([f'frame rate lost beside one hostile client; {sum(map(is_fair, hostile))} of {len(hostile)} behaviours meet the goal', f'{GOAL_DISTURBED} %',
                      f'{-worst["change_percent"]:.1f} % at worst ({worst["what"]})', met(is_fair(worst))])
    lines += [[r['what'], f'held up to the limit ± {100 * IDLE_SLACK:.0f} %, the rest refused', f'{r["held"]:.0f} held, {r["refused"]:.0f} refused', met(is_as_configured(r))] for r in part('idle')]
    if len(soak) > 1:
        grown, steady = flat_memory(soak)
        lines.append([f'memory growth in the second half of a soak of {soak[-1]["minute"]:.0f} minutes', f'{GOAL_GROWTH} %', f'{grown:.1f} %', met(grown <= GOAL_GROWTH)])
        lines.append(['descriptors in the second half', 'no more than before', 'equal' if steady else 'more', met(steady)])
    return table(['what', 'goal', 'measured', ''], lines)


def hostile_table(rows):
    lines = [[r['what'], f'{r["change_percent"]:+.1f} %', short(r['alone_p95_ms']), short(r['p95_ms']), met(is_fair(r))]
             for r in sorted((r for r in rows if r['part'] == 'hostile'), key=lambda r: r['change_percent'])]
    return table(['behaviour of the other client', 'change of the frame rate', 'p95 ms alone', 'p95 ms beside it', f'goal −{GOAL_DISTURBED} %'], lines)


def serve(folder):
    rows, soak = read(folder, 'serve.csv'), read(folder, 'soak.csv')
    volumes = sorted({r['volume'] for r in rows})
    texts = [serve_goals(rows, soak), volumes and f'All clients view {", ".join(volumes)}.\n',
             'One user at 512², alone and then beside one hostile client, in turns (medians of the rounds):\n\n' + hostile_table(rows) if rows else '']
    return '\n'.join(text for text in texts if text)


def motion_goal(row):
    """Where the frame rate that the client asked for is the limit, changes have to wait for it."""
    changes, most = re.search(r'(60 changes|a change per frame).* max_fps (\d+)$', row['what']).groups()
    if row['fps_mean'] >= 0.98 * float(most) and (changes != '60 changes' or float(most) < 60):
        return '– (max_fps)'
    return met(row['wait_p50_ms'] <= GOAL_WAIT_MS[0] and row['wait_p95_ms'] <= GOAL_WAIT_MS[1])


def latency(folder):
    rows = read(folder, 'latency.csv')
    motion = [[r['what'], f'{r["clients"]:.0f}', *(short(r[k]) for k in ('fps_mean', 'work_ms', 'p50_ms', 'p95_ms', 'wait_p50_ms', 'wait_p95_ms')), motion_goal(r)]
              for r in rows if r['part'] == 'motion']
    loop = [[r['what'], f'{r["clients"]:.0f}', *(short(r[k]) for k in ('fps_mean', 'work_ms', 'wait_p50_ms', 'wait_p95_ms')),
             met(r['wait_p95_ms'] <= GOAL_REQUEST_MS) if r['clients'] == 1 else '–'] for r in rows if r['part'] == 'loop']
    return '\n'.join(text for text in (
        table(['backend, changes', 'sessions', 'fps', 'work ms', 'p50 ms', 'p95 ms', 'wait p50 ms', 'wait p95 ms', f'goal: wait ≤ {GOAL_WAIT_MS[0]} and {GOAL_WAIT_MS[1]} ms'], motion),
        table(['backend', 'parallel requests', 'images per second', 'work ms', 'wait p50 ms', 'wait p95 ms', f'goal: wait p95 ≤ {GOAL_REQUEST_MS} ms'], loop)) if text)


GOAL_FIRST_MS = 1000
GOAL_DRAG_PERCENT = 10


def browser(folder):
    rows, lines = read(folder, 'browser.csv'), []
    for volume in dict.fromkeys(r['volume'] for r in rows):
        first, turn, points = (find(rows, volume=volume, what=what) for what in ('first', 'turn', 'points'))
        if not (first and turn and points):
            continue
        lines.append([volume, f'{first["p50_ms"]:.0f}', met(first['p50_ms'] <= GOAL_FIRST_MS),
                      *(text for r in (turn, points) for text in (short(r['fps']), f'{r["p50_ms"]:.0f}, {r["p95_ms"]:.0f} of {r["allowed_ms"]:.0f}', met(r['p95_ms'] <= r['allowed_ms']))),
                      met(points['fps'] >= (1 - GOAL_DRAG_PERCENT / 100) * turn['fps'])])
    return table(['volume', 'first picture ms', f'goal {GOAL_FIRST_MS} ms', 'turning: fps', 'p50, p95 ms', 'goal', 'dragging a point: fps', 'p50, p95 ms', 'goal',
                  f'goal: fps within {GOAL_DRAG_PERCENT} % of turning'], lines)


def network(folder):
    """Rows: rate, stalls and format; columns: round trips."""
    rows = read(folder, 'network.csv')
    trips = sorted({r['rtt_ms'] for r in rows})
    lines = []
    for key in dict.fromkeys((r['mbit'], r['stalls_percent'], r['format']) for r in rows):
        cells = [f'{key[0]:g}', f'{key[1]:g} %', key[2]]
        for trip in trips:
            r = find(rows, rtt_ms=trip, mbit=key[0], stalls_percent=key[1], format=key[2])
            missed = ' ✗' if r and r['p50_ms'] > r['allowed_ms'] else ''
            cells.append(f'{short(r["fps_mean"], 2)} fps, {r["p50_ms"]:.0f} ms of {r["allowed_ms"]:.0f}{missed}' if r else '–')
        lines.append(cells)
    return table(['Mbit/s', 'stalls', 'format', *(f'round trip {trip:g} ms' for trip in trips)], lines)


def element_table(folder, name):
    lines = [[r['volume'], r['layer'], f'{r["mip"]:.0f}', f'{r["splats"]:,.0f}', short(r['median_ms']), short(r['cpu_ms']), short(r['fps'])]
             for r in read(folder, name)]
    return table(['volume', 'layer', 'mip level', 'splats', 'ms', 'CPU ms', 'frames per second'], lines)


def elements(folder):
    goals = [[what, goal, short(value), '–' if good is None else met(good), name]
             for name, find_goals in (('elements.csv', element_goals), ('drag.csv', drag_goals)) for what, goal, value, good in find_goals(read(folder, name))]
    return (f'{table(GOAL_HEAD, goals)}\n' if goals else '') + element_table(folder, 'elements.csv')


def memory(folder):
    lines = [[r['what'], f'{r["side"]:.0f}² px, {r["layers"]:.0f} layers', short(r['rss_mib']), short(r['peak_mib']), short(r['counted_mib']), f'{r["render_bytes_mib"]:.0f}']
             for r in read(folder, 'memory.csv')]
    return table(['after', 'size', 'resident, MiB', 'peak so far', 'counted as frames', 'limit'], lines)


def codecs(folder):
    rows = read(folder, 'codecs.csv')
    lines = []
    for r in rows:
        if r['scene'] != rows[0]['scene']:
            continue
        lines.append([r['codec'], f'{r["quality"]:.0f}', *(short(r[k] / 1000) for k in ('key_bytes', 'bytes')), short(r['ms']), short(r['cpu_ms'])])
    text = table(['codec', 'quality', 'kB, first frame', 'kB, later frames', 'ms', 'CPU ms'], lines)
    return text and f'{rows[0]["scene"]} at {rows[0]["size"]:.0f}².\n\n{text}'


def exact_table(rows):
    """Rows: methods; columns: fields."""
    fields = list(dict.fromkeys(r['field'] for r in rows))
    has_rise = any(r['rise_px'] != '' for r in rows)
    lines = []
    for method in dict.fromkeys(r['method'] for r in rows):
        own = {r['field']: r for r in rows if r['method'] == method}
        rises = [f'{r["rise_px"]:.2f} of {r["exact_rise_px"]:.2f} px' for r in own.values() if r['rise_px'] != '']
        lines.append([method, *(f'{own[f]["psnr_db"]:.1f} dB, {short(own[f]["ms"], 2)} ms' if f in own else '–' for f in fields),
                      *([rises[0] if rises else '–'] if has_rise else [])])
    return table(['method', *fields, *(['edge of the shell'] if has_rise else [])], lines)


def exact(folder):
    rows = read(folder, 'exact.csv')
    if not rows:
        return ''
    texts = [f'{title}:\n\n' + exact_table(own) for title, shading in (('Unshaded', 'none'), ('Shaded', 'phong'))
             if (own := [r for r in rows if r['shading'] == shading])]
    if os.path.exists(os.path.join(folder, 'exact.png')):
        texts.append('![exact; sheets, per voxel; sheets, per pixel; VTK](exact.png)\n')
    return '\n'.join(texts)


def headline(folder):
    """Lines for the project's README: two threads, 512², unshaded."""
    rows = read(folder, 'scenes.csv')
    lines, ratios = [], []
    for own in ordered([r for r in rows if (r['renderer'], r['size'], r['threads'], r['shading']) == ('splatd', 512, 2, 'none')]):
        fps, ratio = against_vtk(rows, own)
        parts = [f'{short(fps, 2)} frames per second']
        if ratio:
            ratios.append(ratio)
            parts.append(f'{ratio:.1f} times VTK\'s CPU ray caster')
        lines.append(f'- {own["scene"]}, {own["splats"] / 1e6:.2f} million splats: ' + ', '.join(parts))
    if ratios:
        lines.insert(0, f'- {min(ratios):.1f} to {max(ratios):.1f} times VTK\'s CPU ray caster at 512² with two threads')
    return '\n'.join(lines) + '\n' if lines else ''


FILES = [
    ('scenes.csv', 'every scene at every size, thread count and shading: this renderer, VTK, the scalar reference'),
    ('pixels.csv', 'every scene, classified per pixel: this renderer and VTK'),
    ('profile.csv', 'time per stage'), ('limit.csv', 'the highest rate of adding footprints, per instruction set; memory bandwidth'),
    ('exact.csv', 'images of analytic fields against the exact image'), ('adaptive.csv', 'adaptive filtering against ewa'), ('detail.csv', 'level of detail against all voxels'),
    ('layers.csv', 'shells, surfaces and projections against the volume layer'),
    ('elements.csv', 'points, Gaussians, triangles and vectors'), ('drag.csv', 'a user who drags ten million points'),
    ('edits.csv', 'a transfer function that changes with every frame'), ('scaling.csv', 'volumes of 64³ to 1024³ voxels'),
    ('cancel.csv', 'time from setting the cancel flag to the return of the call'), ('gl.csv', 'the GPU backend'),
    ('gl_pixels.csv', 'the GPU backend, classified per pixel'), ('gl_vtk.csv', 'VTK\'s GPU ray caster on the same GPU'),
    ('gl_streams.csv', 'sessions of 1024 px that turn, on the GPU backend'), ('gl_edits.csv', 'a changing transfer function on the GPU backend'), ('gl_elements.csv', 'elements.csv on the GPU backend'),
    ('serve.csv', 'the daemon with its clients'), ('latency.csv', 'from a change to its image'), ('network.csv', 'the same over slow and distant networks'),
    ('browser.csv', 'the page in Chromium'), ('bricks.csv', 'volumes that are larger than memory'), ('memory.csv', 'the memory of frames'),
    ('soak.csv', 'the daemon with clients that come and go'), ('codecs.csv', 'bytes and time per image format and video codec'),
    ('tls.csv', 'the TLS acceptor'), ('machine.csv', 'the machine and the commits'),
]


def files(folder):
    return table(['file', 'content'], [[f'[{name}]({name})', about] for name, about in FILES if os.path.exists(os.path.join(folder, name))])


SECTIONS = [
    ('Speed', scenes, 'Sheets that are classified per voxel. Frames per second with two threads, and in brackets the ratio to VTK\'s CPU ray caster in the same run. Medians over an orbit. '
     'No voxel of bonsai-soft, turbulence and noise is transparent; they have no goal. '
     'The last column compares 512², unshaded, with the frame rates that Chen et al. 2004 and Botha and Post 2003 print for their own graphics cards.'),
    ('Speed per pixel', pixels, 'The same for sheets that are classified per pixel, which most views get by default and which are sharper (below). Two threads, '
     'eight views of each orbit. The goal is for all four columns.'),
    ('Goals of the renderer', goals, ''),
    ('Against exact images', exact, 'Measured by `exact.py`: analytic fields on 64³ samples, 256², two threads. The exact image integrates the formula of the field itself, so '
     'that neither renderer is judged by its own interpolation; where it is shaded, by the gradient of the formula. The field `smooth` is a control: it changes so slowly that all '
     'methods must agree with the exact image. The edge of the shell rises from 10 to 90 % over the given distance; nearer to the exact one is better. Times are medians over a '
     'camera that turns. The image shows, from left to right, exact, sheets per voxel, sheets per pixel and VTK at sample distance 1; the last two rows are shaded.'),
    ('Where the time goes', profile, '512², two threads, unshaded: share of each stage. The limit is the time to set up and add every footprint on its own, '
     'at the best rates of `limit.csv`. Above 100 % means faster than this limit: the fast path does not draw every footprint.'),
    ('Points, Gaussians, triangles and vectors', elements, 'An orbit around each at 512² on two threads; the last row has four layers in one frame. Points are merged up to 4 pixels at mip level 1 and 8 at level 2: while a view moves, the '
     'daemon chooses the level that keeps its frame rate. Milliseconds and frames per second are wall times and depend on what else ran on the machine, whose load '
     'is above; CPU time does so much less. The splats of a mesh are its triangles. The layer volume is drawn splat by splat, to compare vectors with.'),
    ('The GPU backend', gpu, ''),
    ('The daemon', serve, 'Measured by `serve.mjs`. Its clients share the machine with the daemon, so their work is part of every figure. Latency is the time '
     'from a change of the view to its image.'),
    ('From hand to picture', latency, 'Measured by `serve.mjs` over loopback at 512². Work is rendering and encoding; wait is the rest of the time from a change of the view to its image: '
     'pacing, scheduling, transport and the client. A renderer that is busy all the time begins a frame when the last one ends; by then the newest of 60 changes per second is 8 ms old '
     'on average. The second table is a script that requests one image after the other.'),
    ('The page in the browser', browser, 'Measured by `browser.mjs` in Debian\'s Chromium at 1024², on the same two cores as the daemon. Latency is the time from a pointer event to the '
     'picture that shows it; its p95 may be 60 ms and the time to render and encode. Turning and dragging a point of the transfer function alternate.'),
    ('Slow and distant networks', network, 'Measured by `network.mjs` at 512², 60 changes per second and `max_fps` 60, through a proxy that delays, limits the rate and stalls. Each cell has the frames per second, '
     'the median time from a change to its image, and the goal for it. The goal is the sum of the round trip, two frame times and the time to send a frame. `auto` lets the daemon replace images by VP8. A stall delays a packet, and all after it, by a round trip; at 200 ms and '
     'seven packets per frame most frames arrive late.'),
    ('Larger than memory', bricks, 'Measured by `bricks.mjs` with `--memory 512M`: winding vessels in empty space, uint8, as brick files in the page cache. From the request that opens the volume, and then from the request of a '
     f'stream to its first frame and to its final one. Goals: first picture within {GOAL_LOAD_MS} ms, the default view complete within {GOAL_COMPLETE_MS // 1000} s, peak memory of the daemon at most the budget and 10 %. The view *near* is six '
     'times nearer. Where the bricks of a level do not fit into the budget, the least important ones have a coarser level than their pixels ask for. The source is a file with holes; the peak of the conversion is that of `splatctl` without the page cache.'),
    ('Memory of frames', memory, 'Measured by `memory.mjs`: resident memory of the daemon on the CPU backend with two threads after each of twenty images over HTTP, and after a session, of the volume and '
     'seven surfaces, against `--render-bytes`. '
     'Three images of 4096² left 3625 MiB for as long as the daemon ran, with a peak of 3813 MiB, before the memory of frames was limited; now the peak is 360 MiB.'),
    ('Codecs', codecs, 'The camera turns by 2° per frame. CPU time is the sum over all threads. Qualities are nominal: the loss of image quality is not compared.'),
    ('Files', files, ''),
]


def page(folder):
    about = {r['key']: r['value'] for r in read(folder, 'machine.csv')}
    parts = ['# Benchmark results\n', '`tests/bench/report.py` writes this page from the CSV files beside it; `deploy/bench.sh` measures them again. '
             'Absolute figures belong to this machine. Ratios come from one run.\n',
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
    """Writes the charts of a section and returns their file names."""
    if make is scenes:
        rows = read(folder, 'scenes.csv')
        groups = []
        for own in ordered([r for r in rows if (r['renderer'], r['size'], r['threads'], r['shading']) == ('splatd', 512, 2, 'none')]):
            fps, ratio = against_vtk(rows, own)
            groups.append((own['scene'], [fps, fps / ratio if ratio else None, max((f for f, _ in PAPERS.get(own['scene'], [])), default=None)]))
        svg = charts.bars('Frames per second, 512 × 512, two threads', ('splatd', 'VTK', 'papers, their cards'), groups)
        name = 'scenes.svg'
    elif make is goals:
        rows = [r for r in read(folder, 'scaling.csv') if r['threads'] == 2]
        svg = charts.lines('Milliseconds per frame of demo:sparse, 512 × 512, two threads', ('level of detail auto', 'off'),
                           [[(r['volume_size'], r[k]) for r in rows] for k in ('auto_ms', 'off_ms')], 'voxels per side')
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
