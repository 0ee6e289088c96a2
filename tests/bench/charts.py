# SPDX-License-Identifier: Apache-2.0
"""Charts of the bench page as SVG text, without a library."""
import math

COLOURS = ('#1f6feb', '#8b949e', '#d29922', '#2da44e')
FONT = 'font-family="sans-serif" font-size="12"'


def text(x, y, content, anchor='start', extra=''):
    safe = content.replace('&', '&amp;').replace('<', '&lt;')
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="#57606a" {FONT} {extra}>{safe}</text>'


def frame(width, height, title, parts):
    return '\n'.join([f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}">',
                      f'<rect width="{width}" height="{height}" fill="#ffffff"/>', text(12, 20, title, extra='font-weight="bold"'),
                      *parts, '</svg>', ''])


def ticks(low, high):
    """Returns 1, 2 and 5 times powers of ten within [low, high]."""
    found = []
    for power in range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1):
        found += [m * 10.0 ** power for m in (1, 2, 5) if low <= m * 10.0 ** power <= high]
    return found


def legend(names, x, y):
    parts = []
    for i, name in enumerate(names):
        parts += [f'<rect x="{x}" y="{y - 9}" width="10" height="10" fill="{COLOURS[i % len(COLOURS)]}"/>', text(x + 14, y, name)]
        x += 30 + 7 * len(name)
    return parts


def bars(title, names, groups):
    """Draws horizontal bars on a logarithmic axis. `groups` is [(label, [value or None for each name])]."""
    values = [v for _, row in groups for v in row if v]
    if not values:
        return ''
    low, high = min(values) / 1.5, max(values) * 1.3
    left, right, top, bar = 120, 660, 60, 13
    height = top + sum(len(names) * bar + 12 for _ in groups) + 30

    def at(v):
        return left + (right - left) * math.log(v / low) / math.log(high / low)
    parts = legend(names, 12, 42)
    for v in ticks(low, high):
        parts += [f'<line x1="{at(v):.1f}" y1="{top - 6}" x2="{at(v):.1f}" y2="{height - 24}" stroke="#d8dee4"/>',
                  text(at(v), height - 8, f'{v:g}', 'middle')]
    y = top
    for label, row in groups:
        parts.append(text(left - 8, y + len(names) * bar / 2 + 4, label, 'end'))
        for i, v in enumerate(row):
            if v:
                parts += [f'<rect x="{left}" y="{y:.1f}" width="{at(v) - left:.1f}" height="{bar - 2}" fill="{COLOURS[i % len(COLOURS)]}"/>',
                          text(at(v) + 4, y + bar - 3, f'{v:.3g}')]
            y += bar
        y += 12
    return frame(720, height, title, parts)


def lines(title, names, series, x_label):
    """Draws lines on two logarithmic axes. `series` is [[(x, y)…] for each name]."""
    points = [p for s in series for p in s if p[1] > 0]
    if len(points) < 2:
        return ''
    (x0, x1), (y0, y1) = ((min(c), max(c)) for c in zip(*points))
    y0, y1 = y0 / 1.3, y1 * 1.3
    left, right, top, bottom = 60, 640, 60, 330

    def at(x, y):
        across = math.log(x / x0) / math.log(x1 / x0) if x1 > x0 else 0.5
        return left + (right - left) * across, bottom - (bottom - top) * math.log(y / y0) / math.log(y1 / y0)
    parts = legend(names, 12, 42) + [text((left + right) / 2, bottom + 36, x_label, 'middle')]
    for y in ticks(y0, y1):
        parts += [f'<line x1="{left}" y1="{at(x0, y)[1]:.1f}" x2="{right}" y2="{at(x0, y)[1]:.1f}" stroke="#d8dee4"/>',
                  text(left - 6, at(x0, y)[1] + 4, f'{y:g}', 'end')]
    parts += [text(at(x, y0)[0], bottom + 18, f'{x:g}', 'middle') for x in sorted({p[0] for p in points})]
    for i, s in enumerate(series):
        path = ' '.join(f'{a:.1f},{b:.1f}' for a, b in (at(x, y) for x, y in s if y > 0))
        parts.append(f'<polyline points="{path}" fill="none" stroke="{COLOURS[i % len(COLOURS)]}" stroke-width="2"/>')
    return frame(720, bottom + 50, title, parts)
