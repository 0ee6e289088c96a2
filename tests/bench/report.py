#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes the pages of benchmark results: report.py DIR reads DIR/*.csv and writes DIR/README.md, one page per subject and two charts.

README.md is one screen: the machine, the headlines, the goals met and missed, and links. A table whose file is missing is left out, and so is
a page without tables. The files DIR/notes/*.md are written by hand; they hold the findings that no program can write, and the pages link to
them. The speed headline is also printed.
"""
import os
import sys
import textwrap
from typing import NamedTuple

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import charts  # noqa: E402
from brick_goals import bricks, bricks_headline, GOAL_COMPLETE_MS, GOAL_LOAD_MS  # noqa: E402
from daemon_tables import browser, codecs, codecs_headline, latency, latency_headline, memory, motion, motion_headline, network, serve, serve_headline, settle  # noqa: E402
from gpu_tables import gpu, gpu_headline  # noqa: E402
from scene_tables import (against_vtk, drafts, elements, elements_headline, exact, exact_headline, goals, headline, layers, layers_headline, overview, scans,  # noqa: E402
                          PAPERS, pixels, pixels_headline, profile, scenes, speed_headline)
from tables import ordered, read, table, verdicts  # noqa: E402

AGAIN = ', measured again'  # the end of a key of machine.csv; its beginning is the name of a CSV file, or the part of it before "_"
WIDTH = 120  # columns of prose

ABOUT = {
    'scenes': 'every scene at every size, thread count and shading: this renderer, VTK, the scalar reference',
    'pixels': 'every scene, classified per pixel: this renderer and VTK',
    'profile': 'time per stage', 'limit': 'the highest rate of adding footprints, per instruction set; memory bandwidth',
    'exact': 'images of analytic fields against the exact image', 'scans': 'images of scans against brute force, and how they change while turning', 'adaptive': 'adaptive filtering against ewa', 'detail': 'level of detail against all voxels',
    'layers': 'shells, surfaces and projections against the volume layer',
    'elements': 'points, Gaussians, triangles and vectors', 'drag': 'a user who drags ten million points',
    'edits': 'a transfer function that changes with every frame', 'scaling': 'volumes of 64³ to 1024³ voxels',
    'cancel': 'time from setting the cancel flag to the return of the call', 'gl': 'the GPU backend',
    'gl_pixels': 'the GPU backend, classified per pixel', 'gl_vtk': 'VTK\'s GPU ray caster on the same GPU',
    'gl_streams': 'sessions of 1024 px that turn, on the GPU backend', 'gl_edits': 'a changing transfer function on the GPU backend', 'gl_elements': 'elements.csv on the GPU backend',
    'serve': 'the daemon with its clients', 'latency': 'from a change to its image', 'network': 'the same over slow and distant networks',
    'browser': 'the page in Chromium', 'motion': 'what a user sees while the view moves', 'motion_before': 'the same before moving frames were ahead of the hand (4196a09e)', 'settle': 'what a user sees after the hand stops', 'settle_before': 'the same before refinements began earlier (4196a09e)', 'bricks': 'volumes that are larger than memory', 'memory': 'the memory of frames',
    'soak': 'the daemon with clients that come and go', 'codecs': 'bytes and time per image format and video codec',
    'tls': 'the TLS acceptor',
}


class Page(NamedTuple):
    name: str  # of the file, without .md
    title: str
    headline: object  # folder → a short text, "" where nothing was measured
    sections: list  # (title, folder → tables, explanation)
    files: list  # the names of CSV files, without .csv
    notes: list = []  # files in notes/, without .md


PAGES = [
    Page('speed', 'Speed per voxel, and goals of the renderer', speed_headline, [
        ('Speed', scenes,
         'Sheets that are classified per voxel. Frames per second with two threads, and in brackets the ratio to VTK\'s CPU ray caster in the same run. '
         'Medians over an orbit. No voxel of bonsai-soft, turbulence and noise is transparent; they have no goal. The last column compares 512², unshaded, '
         'with the frame rates that Chen et al. 2004 and Botha and Post 2003 print for their own graphics cards.'),
        ('Goals of the renderer', goals, ''),
        ('Where the time goes', profile,
         '512², two threads, unshaded: share of each stage. The limit is the time to set up and add every footprint on its own, at the best rates of '
         '`limit.csv`. Above 100 % means faster than this limit: the fast path does not draw every footprint.'),
    ], ['scenes', 'profile', 'limit', 'adaptive', 'detail', 'edits', 'scaling', 'cancel', 'tls'], ['speed', 'slabs']),
    Page('pixels', 'Speed per pixel', pixels_headline, [
        ('Speed per pixel', pixels,
         'Sheets that are classified per pixel, which most views get by default and which are sharper ([exact images](exact.md)). Frames per second, and in '
         'brackets the ratio to VTK\'s CPU ray caster in the same run. Two threads, four to eight views of each orbit. The goal is for all four columns.'),
        ('Drafts', drafts, 'The same while a view moves: drafts, which alternated with the whole frames above.'),
    ], ['pixels'], ['pixels', 'light']),
    Page('exact', 'Against exact images', exact_headline, [
        ('Decibels and times', exact,
         'Measured by `exact.py`: analytic fields on 64³ samples, 256², two threads. The exact image integrates the formula of the field itself, so that '
         'neither renderer is judged by its own interpolation; where it is shaded, by the gradient of the formula. The field `smooth` is a control: it '
         'changes so slowly that all methods must agree with the exact image. The edge of the shell rises from 10 to 90 % over the given distance; nearer '
         'to the exact one is better. Times are medians over a camera that turns. The image shows, from left to right, exact, sheets per voxel, sheets per '
         'pixel and VTK at sample distance 1; the last two rows are shaded.'),
        ('Scans', scans,
         'Measured by `scans.py`: images of the default against a march through a cubic B-spline in double precision (`splat-march`, 16 rays per pixel), '
         'which draws noise as if it were material; and against means of 16 rays per pixel of the renderer itself. Change: rms from frame to frame when the '
         'view turns by 0.1 degrees, in changes of these means; the second number is for one ray per pixel without the low-pass filter.'),
    ], ['exact', 'scans'], ['exact']),
    Page('layers', 'Shells, surfaces and projections', layers_headline, [
        ('Relative rates', layers,
         'How many times as fast shells and an iso-surface are as the volume layer, and the projections as unshaded sheets: in wall time, and in CPU time, '
         'which depends less on other work of the machine. 512², two threads, sheets per pixel, both drawn in turns.'),
    ], ['layers'], ['layers', 'projections']),
    Page('elements', 'Points, Gaussians, triangles and vectors', elements_headline, [
        ('Orbits', elements,
         'An orbit around each at 512² on two threads; the last row has four layers in one frame. Points are merged up to 4 pixels at mip level 1 and 8 at '
         'level 2: while a view moves, the daemon chooses the level that keeps its frame rate. Milliseconds and frames per second are wall times and depend '
         'on the other work of the machine, whose load is below; CPU time depends on it less. The splats of a mesh are its triangles. The layer volume is '
         'drawn splat by splat, to compare vectors with.'),
    ], ['elements', 'drag'], ['elements']),
    Page('gl', 'The GPU backend', gpu_headline, [('Frames per second', gpu, '')], ['gl', 'gl_pixels', 'gl_vtk', 'gl_streams', 'gl_edits', 'gl_elements'], ['gl']),
    Page('serve', 'The daemon', serve_headline, [
        ('Goals', serve,
         'Measured by `serve.mjs`. Its clients share the machine with the daemon, so their work is part of every figure. Latency is the time from a change '
         'of the view to its image.'),
    ], ['serve', 'soak'], ['serve']),
    Page('latency', 'From a change to its image', latency_headline, [
        ('Over loopback', latency,
         'Measured by `serve.mjs` at 512². Work is rendering and encoding; wait is the rest of the time from a change of the view to its image: pacing, '
         'scheduling, transport and the client. A renderer that is busy all the time begins a frame when the last one ends; by then the newest of 60 '
         'changes per second is 8 ms old on average. The second table is a script that requests one image after the other.'),
        ('The page in the browser', browser,
         'Measured by `browser.mjs` in Debian\'s Chromium at 1024², on the same two cores as the daemon. Latency is the time from a pointer event to the '
         'image that shows it; its p95 may be 60 ms and the time to render and encode. Turning and dragging a point of the transfer function alternate.'),
        ('Slow and distant networks', network,
         'Measured by `network.mjs` at 512², 60 changes per second and `max_fps` 60, through a proxy that delays, limits the rate and stalls. Each cell has '
         'the frames per second, the median time from a change to its image, and the goal for it. The goal is the sum of the round trip, two frame times '
         'and the time to send a frame. `auto` lets the daemon replace images by VP8. A stall delays a packet, and all after it, by a round trip; at 200 ms '
         'and seven packets per frame most frames arrive late.'),
    ], ['latency', 'browser', 'network'], ['latency', 'peers']),
    Page('motion', 'What a user sees in motion', motion_headline, [
        ('Turn, zoom and pan', motion,
         'Measured by `motion.mjs`: 60 updates per second, a turn of 34 degrees per second, on the same two cores as the daemon. Each cell has, in dB, the '
         'image on the screen at ticks of the display against the snapshot of the view that was asked for at that moment, over the whole image and in brackets '
         'over the pixels that the object covers; the median width of the frames, and how often per second the image on the screen changes. Before an arrow '
         'stands the daemon and the page of 4196a09e, whose frames are not ahead of the hand, on the same machine in the same hour. Squared errors are summed over '
         'all ticks of a row. A turn goes to and fro at an even speed and turns back at once; a sway goes to and fro with the least jerk, as hands do. The '
         'network is a proxy that delays and limits the rate.'),
        ('After the hand stops', settle,
         'Measured by `settle.mjs`: a turn that stops at once, a sway that comes to its end, a zoom; looks at each tick of the display over the pixels that the '
         'object covers. Each cell has dB after 0, 100, 200 and 300 ms; after how many ms the image is within 1 dB of its final one; and the largest change from '
         'one look to the next, in levels of 255, as a mean over the image. Medians of five stops. Before an arrow stands 4196a09e.'),
    ], ['motion', 'motion_before', 'settle', 'settle_before'], ['motion']),
    Page('memory', 'Memory', bricks_headline, [
        ('Larger than memory', bricks,
         'Measured by `bricks.mjs` with `--memory 512M`: winding vessels in empty space, uint8, as brick files in the page cache. Times are from the '
         'request that opens the volume, and then from the request of a stream to its first frame and to its final one. Goals: first image within '
         f'{GOAL_LOAD_MS} ms, the default view complete within {GOAL_COMPLETE_MS // 1000} s, peak memory of the daemon at most the budget and 10 %. The '
         'view *near* is six times nearer. Where the bricks of a level do not fit into the budget, the least important ones have a coarser level than '
         'their pixels ask for. The source is a file with holes; the peak of the conversion is the memory of `splatctl` without the page cache.'),
        ('Memory of frames', memory,
         'Measured by `memory.mjs`: resident memory of the daemon on the CPU backend with two threads after each of twenty images over HTTP, and after a '
         'session, of the volume and seven surfaces, against `--render-bytes`. Three images of 4096² left 3625 MiB for as long as the daemon ran, with a '
         'peak of 3813 MiB, before the memory of frames was limited.'),
    ], ['bricks', 'memory']),
    Page('codecs', 'Codecs', codecs_headline, [
        ('Bytes and times', codecs,
         'The camera turns by 2° per frame. CPU time is the sum over all threads. Qualities are nominal: the loss of image quality is not compared.'),
    ], ['codecs']),
]


def prose(text):
    return textwrap.fill(text, WIDTH, break_long_words=False, break_on_hyphens=False) + '\n'


def measured_again(about, name):
    """When a CSV file was measured apart from the run of machine.csv, "" if it was not."""
    return about.get(name + AGAIN) or about.get(name.split('_', 1)[0] + AGAIN, '')


def subject(folder, page, about):
    """The page of one subject, "" if nothing of it was measured."""
    parts = []
    for title, make, explained in page.sections:
        body = make(folder)
        if body:
            parts += [f'## {title}\n', *([prose(explained)] if explained else []), body, *(f'![{title}]({name})\n' for name in draw(folder, make))]
    if not parts:
        return ''
    names = [name for name in page.files if os.path.exists(os.path.join(folder, name + '.csv'))]
    parts += ['## Files\n', table(['file', 'content', 'measured again'], [[f'[{name}.csv]({name}.csv)', ABOUT[name], measured_again(about, name)] for name in names])]
    notes = [f'[{name}](notes/{name}.md)' for name in page.notes if os.path.exists(os.path.join(folder, 'notes', name + '.md'))]
    parts += [f'Findings, and what was tried without gain: {", ".join(notes)}.\n'] if notes else []
    return '\n'.join([f'# {page.title}\n', '`tests/bench/report.py` writes this page; [all results](README.md), with the machine.\n', *parts])


def goals_cell(missed, where):
    return f'{missed}: {"; ".join(where)}' if missed else '–'


def summary(folder, about, texts):
    """README.md. texts: pairs of a page and its text, without the empty ones."""
    own = [[key, f'{value:g}' if isinstance(value, float) else value] for key, value in about.items() if not key.endswith(AGAIN)]
    lines = []
    for page, text in texts:
        met_count, missed, where = verdicts(text)
        lines.append([f'[{page.title}]({page.name}.md)', page.headline(folder), met_count or '–', goals_cell(missed, where)])
    parts = ['# Benchmark results\n',
             prose('`tests/bench/report.py` writes these pages from the CSV files beside them; `deploy/bench.sh` measures them again. Absolute figures belong to '
                   'the machine of their run: this one, or the one that the page of the subject names. Ratios come from one run.'), table(['', ''], own),
             '## Speed\n',
             prose('Frames per second at 512², unshaded, on two threads, and in brackets the ratio to VTK\'s CPU ray caster in the same run. Most views are '
                   'classified per pixel by default; classified per voxel they are softer. The goal per pixel is for the worst ratio of four: 512² and 1024², '
                   'shaded and unshaded.'),
             overview(folder), '![Speed](scenes.svg)\n', '## Subjects and goals\n', table(['page', 'headline', 'goals met', 'missed'], lines)]
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
    about = {r['key']: r['value'] for r in read(folder, 'machine.csv')}
    texts = {page.name: (page, subject(folder, page, about)) for page in PAGES}
    texts = {name: pair for name, pair in texts.items() if pair[1]}
    for name, text in [(name, text) for name, (_, text) in texts.items()] + [('README', summary(folder, about, texts.values()))]:
        with open(os.path.join(folder, name + '.md'), 'w', encoding='utf-8') as f:
            f.write(text)
    sys.stdout.write(headline(folder))
    return 0


if __name__ == '__main__':
    sys.exit(main())
