# SPDX-License-Identifier: Apache-2.0
"""The goals of volumes that are larger than memory."""
from tables import met, read, short, table

GOAL_LOAD_MS, GOAL_COMPLETE_MS, GOAL_BUDGET = 1000, 10000, 1.1  # the last one: times --memory


def brick_verdict(row):
    """Opening the volume counts for the first image. Goals of the complete image are for the default view."""
    first, peak = row['load_ms'] + row['first_ms'] <= GOAL_LOAD_MS, row['peak_bytes'] <= GOAL_BUDGET * row['memory_bytes']
    if not (first and peak) or row['view'] != 'default':
        return met(first and peak)
    if not row['is_complete']:
        return '**missed**: finer levels do not fit'
    return met(row['complete_ms'] <= GOAL_COMPLETE_MS)


def bricks(folder):
    """Each view of each volume, and then what its conversion took."""
    rows = read(folder, 'bricks.csv')
    views = [[f'{r["side"]:.0f}³', f'{r["view"]}, {r["width"]:.0f} × {r["height"]:.0f}', f'{r["load_ms"]:.0f} + {r["first_ms"]:.0f}', f'{r["complete_ms"]:.0f}',
              f'{r["level"]:.0f}' + (f' of {r["asked"]:.0f}' if r['asked'] != r['level'] else ''), f'{r["bricks"]:.0f}', short(r['read_bytes'] / 1000), f'{r["peak_bytes"] / 2**20:.0f}', brick_verdict(r)]
             for r in rows]
    made = {r['side']: [f'{r["side"]:.0f}³', f'{r["side"] ** 3 / 2**30:g}', f'{r["matter_bytes"] / 2**20:.0f}', f'{r["file_bytes"] / 2**20:.2g}', short(r['convert_ms'] / 1000),
                        short(r['convert_cpu_ms'] / 1000), f'{r["convert_peak_bytes"] / 2**20:.0f}'] for r in rows if r['matter_bytes'] != ''}
    return '\n'.join(text for text in (
        table(['volume', 'view', 'opening + first image ms', 'complete ms', 'level of the one asked', 'bricks', 'read kB', 'peak MiB', 'goals'], views),
        table(['volume', 'GiB', 'rows with matter, MiB', 'brick file, MiB', 'conversion s', 'CPU s', 'peak MiB'], list(made.values()))) if text)


def bricks_headline(folder):
    rows = read(folder, 'bricks.csv')
    if not rows:
        return ''
    side = max(r['side'] for r in rows)
    first = next(r for r in rows if r['side'] == side)
    return f'first image of {side:.0f}³ samples with {first["memory_bytes"] / 2**20:.0f} MiB: {first["load_ms"] + first["first_ms"]:.0f} ms'
