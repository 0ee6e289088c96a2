// SPDX-License-Identifier: Apache-2.0
// Places for labels beside what they name, so that none covers another, nor a line if there is space. All lengths are px.

const EDGE_PX = 2; // to the border of the picture
const GAP_PX = 2; // between two labels
const DOT_PX = 6; // around a point that should stay visible
const STEP_PX = [24, 9];
const REACH_PX = [192, 180];
const LEADER_PX = 12; // a label that is moved less needs no line to its place

/** Offsets from the wanted place, nearest first; upwards and downwards before sideways, because labels are wide. */
const OFFSETS = (() => {
  const steps = (axis) => {
    const count = REACH_PX[axis] / STEP_PX[axis];
    return Array.from({ length: 2 * count + 1 }, (_, i) => (i - count) * STEP_PX[axis]);
  };
  const all = steps(0).flatMap((x) => steps(1).map((y) => ({ x, y, far: Math.hypot(x * 0.8, y) + (x < 0 ? 0.2 : 0) + (y < 0 ? 0.1 : 0) })));
  return all.sort((a, b) => a.far - b.far);
})();

const isOver = (a, b) => Math.abs(a.x - b.x) < (a.width + b.width) / 2 + GAP_PX && Math.abs(a.y - b.y) < (a.height + b.height) / 2 + GAP_PX;

/** The middle of a label moved into the picture. */
function moveInside({ x, y, width, height }, [right, bottom]) {
  const inside = (at, side, most) => Math.max(Math.min(at, most - side / 2 - EDGE_PX), side / 2 + EDGE_PX);
  return { x: inside(x, width, right), y: inside(y, height, bottom), width, height };
}

/** Returns the leader line of a label: from the nearest point of its measurement to the label's border. Null if the label is near. */
function leaderOf(place, wanted, anchors) {
  if (Math.hypot(place.x - wanted.x, place.y - wanted.y) < LEADER_PX || anchors.length === 0) return null;
  const away = (point) => Math.hypot(point.x - place.x, point.y - place.y);
  const from = anchors.reduce((best, point) => (away(point) < away(best) ? point : best));
  const clamp = (at, middle, side) => Math.min(Math.max(at, middle - side / 2), middle + side / 2);
  return { from, to: { x: clamp(from.x, place.x, place.width), y: clamp(from.y, place.y, place.height) } };
}

/**
 * Places labels {wanted: {x, y} of the middle, size: [width, height], anchors: points that a leader line may begin at}, earlier ones first,
 * in a picture of `size`. `dots`: points that they should not cover; `covers`: what lies above the picture and would hide them, as
 * {x, y of the middle, width, height}. Returns for each {x, y, leader: {from, to} or null}, or null if there is
 * no free place near enough.
 */
export function placeLabels(labels, size, dots = [], covers = []) {
  const placed = [...covers];
  const near = dots.map(({ x, y }) => ({ x, y, width: DOT_PX, height: DOT_PX }));
  return labels.map(({ wanted, size: [width, height], anchors }) => {
    const start = moveInside({ ...wanted, width, height }, size);
    let best = null;
    for (const offset of OFFSETS) {
      const place = moveInside({ ...start, x: start.x + offset.x, y: start.y + offset.y }, size);
      if (placed.some((other) => isOver(other, place))) continue;
      best ??= place; // covers a line
      if (near.some((dot) => isOver(dot, place))) continue;
      best = place;
      break;
    }
    if (!best) return null;
    placed.push(best);
    return { x: best.x, y: best.y, leader: leaderOf(best, wanted, anchors) };
  });
}
