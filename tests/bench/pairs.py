# SPDX-License-Identifier: Apache-2.0
"""The parts of the bench that draw each view twice, with two settings in turn, so that a drift of the machine cancels out."""
import json

from peer import chosen


def flat(row, **more):
    return {**row, **more}


PAIR_COLUMNS = ['scene', 'zoom', 'size', 'threads', 'shading', 'setting', 'against', 'views', 'splats', 'against_splats', 'median_ms',
                'against_median_ms', 'speedup', 'cpu_speedup', 'psnr_db', 'psnr_worst_db']


def pair(row, setting, zoom=1):
    other = row['against']
    return flat(row, zoom=zoom, setting=setting, against=other['setting'], against_splats=other['splats'],
                against_median_ms=other['median_ms'], **{k: other.get(k, '') for k in PAIR_COLUMNS[-4:]})


def zoomed(run, name, zoom, views):
    """Returns a scene with the camera `zoom` times as near."""
    def change(scene):
        scene['cameras'] = chosen(scene['cameras'], views)
        for c in scene['cameras']:
            c['position'] = [t + (p - t) / zoom for p, t in zip(c['position'], c['target'])]
    return run.scene_copy(name, change)


def zooms(run):
    """Returns the scenes that compare filters and levels of detail: all scenes unchanged, and two from near and far."""
    names = [(name, 1) for name in run.scenes]
    for name in ('engine', 'head-full', 'checkerboard'):
        if name in run.scenes:
            names += [(name, zoom) for zoom in (0.125, 0.25, 0.5, 4)]
    return names


def measure_pairs(run, file, options, setting, against):
    rows = []
    for zoom in sorted({z for _, z in zooms(run)}):
        files = [zoomed(run, name, z, max(2, run.o.views // 3)) for name, z in zooms(run) if z == zoom]
        label = f'{setting} against {against}' + (f', from {1 / zoom:g} times the distance' if zoom != 1 else '')
        rows += [pair(row, setting, zoom) for row in run.bench(label, '--size', 512, '--threads', 2, '--warm', 1, *options,
                                                               '--against', against, *files)]
    run.write(file, PAIR_COLUMNS, rows)


def measure_edits(run):
    rows = []
    for edit in ('colour', 'opacity', 'range'):
        for row in run.bench(f'transfer function changing ({edit}) against fixed', '--size', 512, '--threads', 2, '--edit', edit,
                             '--against', 'edit=none', *run.files(run.o.views)):
            rows.append(pair(row, 'edit=' + edit))
    run.write('edits.csv', PAIR_COLUMNS, rows)


def half_opaque(scene):
    """Returns the value at which the scene's transfer function first reaches half of its largest opacity."""
    points = scene['view']['transfer_function']['points']
    half = max(p['opacity'] for p in points) / 2
    for left, right in zip([points[0]] + points, points):
        if right['opacity'] >= half:
            span = right['opacity'] - left['opacity']
            share = (half - left['opacity']) / span if span > 0 and left['opacity'] < half else 0
            return left['value'] + share * (right['value'] - left['value'])
    return points[-1]['value']


def measure_layers(run):
    """Shells, surfaces, projections, and shells with the volume, against the volume layer, in the default order: the same views, frame by frame in turn."""
    rows, views = [], max(2, run.o.views // 3)
    common = ('--size', 512, '--threads', 2, '--warm', 1)

    def add(setting, against, options, names):
        rows.extend(pair(row, setting) for row in run.bench(f'{setting} against {against}', *common, *options,
                                                            *run.files(views, names), order='auto'))
    for detail in ('fast', 'high'):
        shell = {'type': 'shell', 'low': 0.05, 'high': 0.05, 'detail': detail}
        add(f'shell {detail}', 'volume', ('--layers', json.dumps([shell]), '--against', 'layers=volume'), None)
        both = json.dumps([{'type': 'volume'}, shell])
        add(f'shell {detail} and volume', 'volume', ('--layers', both, '--against', 'layers=volume'), None)
    for name in run.scenes:
        surface = json.dumps([{'type': 'surface', 'value': half_opaque(run.all_scenes[name])}])
        add('surface', 'volume', ('--layers', surface, '--against', 'layers=volume'), [name])
    for mode in ('maximum', 'mean'):
        add(mode, 'sheet', ('--compositing', mode, '--against', 'compositing=sheet'), None)
    run.write('layers.csv', PAIR_COLUMNS, rows)
