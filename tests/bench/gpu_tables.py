# SPDX-License-Identifier: Apache-2.0
"""The tables of the GPU backend."""
import math

from scene_tables import CHEN_3, CHEN_4, edit_goals, element_table, GOAL_HEAD, PAPERS, SOFTWARE
from tables import find, met, ORDER, ordered, read, short, table

# Goals on a data-centre GPU, in frames per second, unshaded, by (scene, px).
GOAL_GPU = {(scene, 512): 1000 for scene, found in PAPERS.items() if {CHEN_3, CHEN_4} & {source for _, source in found}}
GOAL_GPU.update({('head-full', 512): 500, ('sparse', 1024): 200})
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


def gpu_headline(folder):
    rates = [r['fps'] for r in read(folder, 'gl_pixels.csv') if (r['backend'], r['size'], r['shading']) == ('gl', 512, 'phong')]
    return f'shaded scenes at 512²: {min(rates):.0f} to {max(rates):.0f} frames per second' if rates else ''
