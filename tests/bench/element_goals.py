# SPDX-License-Identifier: Apache-2.0
"""The goals of points, Gaussians, triangles and vectors."""

FPS, GAUSSIANS = 60, 'demo:gaussians?size=274'
MOVING_FPS, POINTS = 30, 'demo:points?size=1000'
VECTORS = 2  # times the CPU time of scalar splats


def drag_goals(rows):
    """The same for a user who drags the view over a stream. Clients share the machine with the daemon."""
    for row in rows:
        what = f'dragging `{row["volume"]}` over a stream: frames per second, {row["side"]:.0f} of {row["px"]:.0f} px, mip level {row["coarse"]:.2g}'
        yield what, MOVING_FPS, row['fps_mean'], row['fps_mean'] >= MOVING_FPS
        yield 'final frame after the last change, ms', 'none', row['final_ms'], None


def element_goals(rows):
    """Yields what, goal, measured and whether it is met. Other programs on the machine lengthen wall times, so the rate follows from the
    CPU time, spread evenly over the threads."""
    own = {(r['volume'], r['layer'], r['mip']): r for r in rows}
    for volume, mip, what, goal in ((GAUSSIANS, 0, '150,000 Gaussians', FPS), (POINTS, 2, 'ten million points at mip level 2, as while moving', MOVING_FPS)):
        row = own.get((volume, '', mip))
        if row:
            rate = 1000 * row['threads'] / row['cpu_ms']
            yield what + ': frames per second that the CPU time allows', goal, rate, rate >= goal
    vectors, splats = own.get(('demo:tornado', 'vectors, density 1', 0)), own.get(('demo:tornado', 'volume', 0))
    if vectors and splats:
        ratio = vectors['cpu_ms'] / splats['cpu_ms']
        yield 'vectors of all samples relative to the splats of these samples, CPU time', VECTORS, ratio, ratio <= VECTORS
