# SPDX-License-Identifier: Apache-2.0
"""The tables of the daemon and its clients."""
import re

from tables import find, met, read, short, table

# Goals of the daemon; GOAL_DISTURBED and GOAL_GROWTH are percentages.
GOAL_WAIT_MS, GOAL_REQUEST_MS = (4, 14), 3  # beside rendering and encoding: median and p95; p95
GOAL_OVERHEAD_MS, GOAL_USER_FPS, GOAL_VIEWER_MIB, GOAL_SESSION_MIB, GOAL_DISTURBED, GOAL_GROWTH = 5, 10, 2, 16, 5, 5
# The daemon keeps a few connections above its limit open while it tells their clients that it is full.
IDLE_SLACK = 0.1


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


def beside_table(rows, part, head, last):
    """One user beside others. last: the cell at the end of a row."""
    lines = [[r['what'], f'{r["change_percent"]:+.1f} %', short(r['alone_fps']), short(r['fps_mean']), short(r['side']), short(r['alone_p95_ms']), short(r['p95_ms']), last(r)]
             for r in sorted((r for r in rows if r['part'] == part), key=lambda r: r['change_percent'])]
    return table([head[0], 'change of the frame rate', 'fps alone', 'beside', 'px', 'p95 ms alone', 'beside', head[1]], lines)


def serve(folder):
    rows, soak = read(folder, 'serve.csv'), read(folder, 'soak.csv')
    volumes = sorted({r['volume'] for r in rows})
    hostile = beside_table(rows, 'hostile', ('behaviour of the other client', f'goal −{GOAL_DISTURBED} %'), lambda r: met(is_fair(r)))
    others = beside_table(rows, 'beside', ('the others', 'of the others'), lambda r: r['note'].split('; ', 1)[-1])
    texts = [serve_goals(rows, soak), volumes and f'All clients view {", ".join(volumes)}.\n',
             hostile and 'One user at 512², alone and then beside one hostile client, in turns (medians of the rounds):\n\n' + hostile,
             others and 'The same user beside others that take no more than their share:\n\n' + others]
    return '\n'.join(text for text in texts if text)


def serve_headline(folder):
    lost = [-r['change_percent'] for r in read(folder, 'serve.csv') if r['part'] == 'hostile']
    return f'a hostile client costs another user at most {max(lost):.1f} % of the frame rate' if lost else ''


def latency_headline(folder):
    rows = [r for r in read(folder, 'latency.csv') if r['part'] == 'motion' and r['clients'] == 1 and r['what'] == 'cpu, 60 changes per second, max_fps 60']
    return f'60 changes per second on the CPU: {short(rows[0]["fps_mean"])} frames per second, median {short(rows[0]["p50_ms"])} ms' if rows else ''


def motion_goal(row):
    """Says whether the goal is met. If frames come at the rate that the client asked for, changes wait for it and the goal does not apply."""
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
    return table(['volume', 'first image ms', f'goal {GOAL_FIRST_MS} ms', 'turning: fps', 'p50, p95 ms', 'goal', 'dragging a point: fps', 'p50, p95 ms', 'goal',
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
    late = [r for r in rows if r['p50_ms'] > r['allowed_ms']]
    goal = [['cells with a median within their goal', 'all', f'{len(rows) - len(late)} of {len(rows)}', met(not late)]] if rows else []
    return table(['what', 'goal', 'measured', ''], goal) + '\n' + table(['Mbit/s', 'stalls', 'format', *(f'round trip {trip:g} ms' for trip in trips)], lines) if rows else ''


def motion(folder):
    """One table per client; rows: move, size and network; columns: volumes. An arrow follows what was measured before."""
    rows, earlier, texts = read(folder, 'motion.csv'), read(folder, 'motion_before.csv'), []
    volumes = list(dict.fromkeys(r['volume'] for r in rows))
    for client in dict.fromkeys(r['client'] for r in rows):
        lines = []
        for key in dict.fromkeys((r['move'], r['px'], r['rtt_ms'], r['mbit']) for r in rows if r['client'] == client):
            cells = [key[0], f'{key[1]:.0f}', f'{key[2]:g}', f'{key[3]:g}']
            for volume in volumes:
                wanted = {'client': client, 'volume': volume, 'move': key[0], 'px': key[1], 'rtt_ms': key[2], 'mbit': key[3]}
                r, b = find(rows, **wanted), find(earlier, **wanted)
                before = f'{b["seen_db"]:.1f} ({b["seen_object_db"]:.1f}), {b["width_p50"]:.0f} px → ' if b else ''
                cells.append(f'{before}{r["seen_db"]:.1f} ({r["seen_object_db"]:.1f}), {r["width_p50"]:.0f} px, {r["changes_fps"]:.0f}' if r else '–')
            lines.append(cells)
        texts.append({'stream': 'A client that shows the newest image:', 'page': 'The page:'}[client] + '\n\n' +
                     table(['move', 'px', 'round trip ms', 'Mbit/s', *(volume.split('_')[0] for volume in volumes)], lines))
    return '\n'.join(texts)


def settle(folder):
    """Rows: client and move; columns: volumes. An arrow follows what was measured before."""
    rows, earlier, lines = read(folder, 'settle.csv'), read(folder, 'settle_before.csv'), []
    volumes = list(dict.fromkeys(r['volume'] for r in rows))

    def text(r):
        return f'{", ".join(short(r[f"db_{ms}"]) for ms in (0, 100, 200, 300))} dB, {r["near_final_ms"]:.0f} ms, {short(r["jump_levels"], 1)}' if r else '–'

    for key in dict.fromkeys((r['client'], r['move']) for r in rows):
        cells = list(key)
        for volume in volumes:
            wanted = {'client': key[0], 'move': key[1], 'volume': volume}
            r, b = find(rows, **wanted), find(earlier, **wanted)
            cells.append(f'{text(b)} → {text(r)}' if b else text(r))
        lines.append(cells)
    return table(['client', 'move', *(volume.split('_')[0] for volume in volumes)], lines) if rows else ''


def motion_headline(folder):
    rows = [r for r in read(folder, 'motion.csv') if (r['client'], r['move'], r['px'], r['rtt_ms'], r['mbit']) == ('page', 'turn', 1024, 0, 50)]
    texts = [f'{r["volume"].split("_")[0]} {r["seen_object_db"]:.1f} dB' for r in rows]
    return f'the page, turning at 1024², over the object: {", ".join(texts)}' if texts else ''


def memory(folder):
    """One line per state of the daemon; all images of a size share one."""
    groups = {}
    for r in read(folder, 'memory.csv'):
        what = 'images' if r['what'].startswith('image ') else r['what']
        groups.setdefault((r['side'], what), []).append(r)

    def extent(rows, key):
        low, high = (short(end(r[key] for r in rows)) for end in (min, max))
        return low if low == high else f'{low} to {high}'

    lines = [[f'{len(rows)} images' if what == 'images' else what, f'{side:.0f}² px, {rows[0]["layers"]:.0f} layers',
              *(extent(rows, key) for key in ('rss_mib', 'peak_mib', 'counted_mib')), f'{rows[0]["render_bytes_mib"]:.0f}']
             for (side, what), rows in groups.items()]
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


def codecs_headline(folder):
    rows = [r for r in read(folder, 'codecs.csv') if (r['codec'], r['quality']) == ('jpeg 4:2:0', 60)]
    return f'JPEG 4:2:0 of quality 60 at {rows[0]["size"]:.0f}²: {short(rows[0]["bytes"] / 1000)} kB, {short(rows[0]["ms"])} ms' if rows else ''
