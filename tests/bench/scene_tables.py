# SPDX-License-Identifier: Apache-2.0
"""The tables of the renderer on the processor: speed, goals, exact images, stages, layers, elements."""
import os

from element_goals import drag_goals, element_goals
from tables import decibels, find, met, ORDER, ordered, read, short, table

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
GOAL_DRAFT, GOAL_DRAFT_DB = 10, 36  # times VTK, and from the whole frame, drafts
GOAL_ECHO_MS = 200
GOAL_FPS = {'head-full': 40}  # at 512 px, two threads, unshaded
GOAL_ADAPTIVE_DB, GOAL_DETAIL_DB, GOAL_EDIT, GOAL_CANCEL_MS, GOAL_BYTES = 45, 40, 0.90, 5, 2
SOFTWARE = 'software GL, for correctness only'
CLEAN, NARROW = '16 bits', '16 bits, 1 px wide'  # samples of exact.py: without noise; as narrow as pixels
WITHOUT_GOAL = ('bonsai-soft', 'turbulence', 'noise')  # no voxel is transparent


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


def speed_verdict(scene, fps, ratio):
    verdict = '–' if scene in WITHOUT_GOAL else f'{goal(scene)}×: {met(ratio >= goal(scene)) if ratio else "–"}'
    if scene in GOAL_FPS:
        verdict += f', {GOAL_FPS[scene]} fps: {met(fps >= GOAL_FPS[scene])}'
    return verdict


def pixel_ratios(rows, scene):
    """Frames per second and the ratio to VTK of the four columns."""
    return [against_vtk(rows, find(rows, renderer='splatd', scene=scene, size=size, shading=shading)) for size in (512, 1024) for shading in ('none', 'phong')]


def pixel_verdict(rows, scene):
    wanted = GOAL_PIXELS_SPARSE if scene in SPARSE else GOAL_PIXELS
    ratios = [ratio for _, ratio in pixel_ratios(rows, scene) if ratio]
    return f'{wanted}×: {met(min(ratios) >= wanted) if ratios else "–"}'


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
        lines.append([scene, short(first['splats'] / 1e6), *(speed_cell(*pair) for pair in found), speed_verdict(scene, fps, ratio),
                      ', '.join(f'{fps / theirs:.0f}× {source.split()[0]}' for theirs, source in PAPERS.get(scene, [])) or '–'])
    return table(SPEED_HEAD, lines)


def overview(folder):
    """The first columns of both tables of speed, for the first page."""
    rows, pixel_rows = read(folder, 'scenes.csv'), read(folder, 'pixels.csv')
    lines = []
    for scene in sorted({r['scene'] for r in rows + pixel_rows if r['scene'] in ORDER}, key=ORDER.index):
        voxel = against_vtk(rows, find(rows, renderer='splatd', scene=scene, size=512, threads=2, shading='none'))
        pixel = against_vtk(pixel_rows, find(pixel_rows, renderer='splatd', scene=scene, size=512, shading='none'))
        lines.append([scene, speed_cell(*voxel), speed_verdict(scene, *voxel) if voxel[0] else '–', speed_cell(*pixel), pixel_verdict(pixel_rows, scene) if pixel[0] else '–'])
    return table(['scene', 'per voxel', 'goal', 'per pixel', 'goal'], lines)


def speed_headline(folder):
    rows = read(folder, 'scenes.csv')
    return ratio_headline(rows, [r for r in rows if r['threads'] == 2])


def pixels_headline(folder):
    rows = read(folder, 'pixels.csv')
    return ratio_headline(rows, rows)


def ratio_headline(rows, own):
    found = [against_vtk(rows, r)[1] for r in own if (r['renderer'], r['size'], r['shading']) == ('splatd', 512, 'none') and r['scene'] not in WITHOUT_GOAL]
    ratios = [ratio for ratio in found if ratio]
    return f'{min(ratios):.1f} to {max(ratios):.1f} times VTK at 512², unshaded, on volumes with empty voxels' if ratios else ''


PIXELS_HEAD = ['scene', '512², unshaded', '512², shaded', '1024², unshaded', '1024², shaded', 'goal']


def pixels(folder):
    """The same for sheets that are classified per pixel."""
    rows = read(folder, 'pixels.csv')
    lines = []
    for first in ordered([r for r in rows if (r['renderer'], r['size'], r['shading']) == ('splatd', 512, 'none')]):
        scene = first['scene']
        lines.append([scene, *(speed_cell(*pair) for pair in pixel_ratios(rows, scene)), pixel_verdict(rows, scene)])
    return table(PIXELS_HEAD, lines) if lines else ''


DRAFT_HEAD = ['scene', '512², unshaded', '512², shaded', '1024², unshaded', '1024², shaded', 'from the whole frame, at worst', 'goal']


def drafts(folder):
    """Drafts of sheets that are classified per pixel: frames per second, the ratio to VTK, and the distance from whole frames."""
    rows = read(folder, 'pixels.csv')
    lines = []
    for first in ordered([r for r in rows if (r['renderer'], r['size'], r['shading']) == ('draft', 512, 'none')]):
        own = [find(rows, renderer='draft', scene=first['scene'], size=size, shading=shading) for size in (512, 1024) for shading in ('none', 'phong')]
        found = [against_vtk(rows, row) for row in own]
        ratios = [ratio for _, ratio in found if ratio]
        worst = min(row['psnr_worst_db'] for row in own if row)
        is_met = ratios and min(ratios) >= GOAL_DRAFT and worst >= GOAL_DRAFT_DB
        lines.append([first['scene'], *(speed_cell(*pair) for pair in found), decibels(worst),
                      f'{GOAL_DRAFT}×, {GOAL_DRAFT_DB} dB: {met(is_met) if ratios else "–"}'])
    return table(DRAFT_HEAD, lines) if lines else ''


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


def element_table(folder, name):
    lines = [[r['volume'], r['layer'], f'{r["mip"]:.0f}', f'{r["splats"]:,.0f}', short(r['median_ms']), short(r['cpu_ms']), short(r['fps'])]
             for r in read(folder, name)]
    return table(['volume', 'layer', 'mip level', 'splats', 'ms', 'CPU ms', 'frames per second'], lines)


def elements(folder):
    goals = [[what, goal, short(value), '–' if good is None else met(good), name]
             for name, find_goals in (('elements.csv', element_goals), ('drag.csv', drag_goals)) for what, goal, value, good in find_goals(read(folder, name))]
    return (f'{table(GOAL_HEAD, goals)}\n' if goals else '') + element_table(folder, 'elements.csv')


def elements_headline(folder):
    found = [f'{what}: {short(value)}' for what, _, value, _ in element_goals(read(folder, 'elements.csv'))]
    return found[0] if found else ''


LAYERS = ('shell fast', 'shell high', 'surface', 'maximum', 'mean')


def layers(folder):
    """Rates of other layers and of projections, relative to the volume layer and to sheets, one row per scene."""
    rows = [r for r in read(folder, 'layers.csv') if r['setting'] in LAYERS]
    lines = [[first['scene'], *(f'{r["speedup"]:.1f}, {r["cpu_speedup"]:.1f}' if (r := find(rows, scene=first['scene'], setting=name)) else '–' for name in LAYERS)]
             for first in ordered(r for r in rows if r['setting'] == LAYERS[0])]
    return table(['scene', *LAYERS], lines)


def layers_headline(folder):
    rates = [r['cpu_speedup'] for r in read(folder, 'layers.csv') if r['setting'] == 'shell fast']
    return f'shells in `fast` detail: {min(rates):.1f} to {max(rates):.1f} times the rate of the volume layer, in CPU time' if rates else ''


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
    narrow = [r for r in rows if r.get('samples', CLEAN) == NARROW]
    noisy = [r for r in rows if r.get('samples', CLEAN) not in (CLEAN, NARROW)]
    rows = [r for r in rows if r.get('samples', CLEAN) == CLEAN]
    texts = [f'{title}:\n\n' + exact_table(own) for title, shading in (('Unshaded', 'none'), ('Shaded', 'phong'))
             if (own := [r for r in rows if r['shading'] == shading])]
    if noisy:
        texts.append('Shaded, from samples with noise, and from every second slice alone:\n\n' + noise_table(noisy))
    for title, shading in (('unshaded', 'none'), ('shaded', 'phong')):
        if own := [r for r in narrow if r['shading'] == shading]:
            texts.append(f'Samples as narrow as pixels, {title}: against means of 16 rays per pixel, and the rms change when the view turns by 0.1 degrees, '
                         'in thousandths of the range:\n\n' + narrow_table(own))
    if os.path.exists(os.path.join(folder, 'exact.png')):
        texts.append('![exact; sheets, per voxel; sheets, per pixel; VTK](exact.png)\n')
    return '\n'.join(texts)


def noise_table(rows):
    """Rows: samples and methods; columns: fields."""
    fields = list(dict.fromkeys(r['field'] for r in rows))
    lines = []
    for samples, method in dict.fromkeys((r['samples'], r['method']) for r in rows):
        own = {r['field']: r for r in rows if (r['samples'], r['method']) == (samples, method)}
        lines.append([samples, method, *(f'{own[f]["psnr_db"]:.1f} dB' if f in own else '–' for f in fields)])
    return table(['samples', 'method', *fields], lines)


def narrow_table(rows):
    """Rows: methods; columns: fields."""
    fields = list(dict.fromkeys(r['field'] for r in rows))
    lines = []
    for method in dict.fromkeys(r['method'] for r in rows):
        own = {r['field']: r for r in rows if r['method'] == method}
        lines.append([method, *((f'{own[f]["psnr_db"]:.1f} dB, ' if own[f]['psnr_db'] != '' else '') + f'{own[f]["change"]:.1f}' if f in own else '–'
                                for f in fields)])
    return table(['method', *fields], lines)


def scans(folder):
    """Rows: scenes and sizes; columns: without and with light."""
    rows = read(folder, 'scans.csv')
    lines = []
    for scene, size in dict.fromkeys((r['scene'], r['size']) for r in rows):
        own = {r['shading']: r for r in rows if (r['scene'], r['size']) == (scene, size)}
        cells = [[f'{own[s]["march_db"]:.1f} dB' if own[s]['march_db'] != '' else '–', f'{own[s]["means_db"]:.1f} dB',
                  f'{own[s]["change"]:.2f}, {own[s]["point_change"]:.2f}'] if s in own else ['–'] * 3 for s in ('none', 'phong')]
        lines.append([scene, f'{size:.0f}²', *cells[0], *cells[1]])
    return table(['scan', 'size', 'to the march', 'to means', 'change', 'lit: to the march', 'to means', 'change'], lines) if lines else ''


def exact_headline(folder):
    rows = [r for r in read(folder, 'exact.csv') if r['shading'] == 'none' and r.get('samples', CLEAN) == CLEAN]
    found = {method: [r['psnr_db'] for r in rows if r['method'] == method] for method in ('sheets, per pixel', 'VTK, distance 0.5')}
    return '; '.join(f'{method}: {min(values):.1f} to {max(values):.1f} dB' for method, values in found.items() if values)


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
