// SPDX-License-Identifier: Apache-2.0
// Computes from a histogram heights to draw, percentiles, peaks and thresholds. A histogram is {range: [low, high], counts}.

const SPAN = 8e307; // a range of double precision would have an infinite width
const holdRange = (range) => range.map((end) => Math.min(SPAN, Math.max(-SPAN, end)));

/** {range, counts, windows} of a histogram of values, or {x, y, counts} of a joint one, from the daemon's answer. */
export function readHistogram({ axes, counts, type, volume, windows }) {
  const [x, y] = axes;
  const [first, second] = [x, y].map((axis) => axis && { range: holdRange(axis.range), bins: axis.bins });
  return y ? { volume, x: first, y: second, counts } : { volume, type, range: first.range, counts, windows };
}

const widthOf = ({ range: [low, high], counts }) => (high - low) / counts.length;

/** Logarithmic heights in [0, 1] of `columns` equal parts of [from, to]: the largest bin that touches the part. */
export function logHeights(histogram, from, to, columns) {
  const { range, counts } = histogram;
  const width = widthOf(histogram) || 1;
  const most = Math.log1p(Math.max(1, ...counts));
  const bin = (value) => Math.floor((value - range[0]) / width);
  return Array.from({ length: columns }, (_, i) => {
    const first = bin(from + (to - from) * i / columns);
    const last = Math.max(first, bin(from + (to - from) * (i + 1) / columns - width * 1e-6));
    let count = 0;
    for (let b = Math.max(0, first); b <= Math.min(counts.length - 1, last); b += 1) count = Math.max(count, counts[b]);
    return Math.log1p(count) / most;
  });
}

/** The value below which the share `part` of the samples lies; `above` counts only samples of at least that value. */
export function percentile(histogram, part, above = -Infinity) {
  const { range, counts } = histogram;
  const width = widthOf(histogram);
  const first = Math.max(0, Math.min(counts.length - 1, Math.ceil((above - range[0]) / (width || 1) - 1e-9)));
  const rest = counts.slice(first);
  const total = rest.reduce((a, b) => a + b, 0);
  if (!total) return range[1];
  let left = part * total;
  for (let i = 0; i < rest.length; i += 1) {
    if (left <= rest[i]) return range[0] + width * (first + i + (rest[i] ? left / rest[i] : 0));
    left -= rest[i];
  }
  return range[1];
}

/** The share of the samples between two values, by whole bins. */
export function shareBetween(histogram, from, to) {
  const { range, counts } = histogram;
  const width = widthOf(histogram);
  const [inside, all] = counts.reduce(([sum, total], count, i) => {
    const middle = range[0] + width * (i + 0.5);
    return [sum + (middle >= from && middle <= to ? count : 0), total + count];
  }, [0, 0]);
  return all > 0 ? inside / all : 0;
}

/** Where the values of a signal begin: above the fullest bin, which is the background, and its noise. Null if more than half of the samples lie below that bin. */
export function backgroundEnd(histogram) {
  const { range, counts } = histogram;
  const width = widthOf(histogram);
  const at = counts.indexOf(Math.max(...counts));
  const sum = (some) => some.reduce((a, b) => a + b, 0);
  const below = counts.slice(0, at);
  if (sum(below) > 0.5 * sum(counts)) return null;
  const spread = below.reduce((all, count, i) => all + count * (at - i) ** 2, 0) / (sum(below) + counts[at] / 2 || 1); // of the lower half: the upper one may be signal
  return range[0] + width * (at + 1 + 4 * Math.sqrt(spread));
}

/** The root mean square of max(value − zero, 0), as the daemon counts it for the window of a sum. */
export function meanAbove(histogram, zero) {
  const { range, counts } = histogram;
  const width = widthOf(histogram);
  const [squares, samples] = counts.reduce(([sum, all], count, b) => {
    const above = b === 0 && zero === range[0] ? 0 : Math.max(range[0] + (b + 0.5) * width - zero, 0);
    return [sum + count * above * above, all + count];
  }, [0, 0]);
  return samples > 0 ? Math.sqrt(squares / samples) : 0;
}

/** The middle of the fullest bin between two values. */
export function peak(histogram, from = -Infinity, to = Infinity) {
  const { range, counts } = histogram;
  const width = widthOf(histogram);
  let best = -1;
  for (let i = 0; i < counts.length; i += 1) {
    const middle = range[0] + width * (i + 0.5);
    if (middle >= from && middle <= to && (best < 0 || counts[i] > counts[best])) best = i;
  }
  return best < 0 ? null : range[0] + width * (best + 0.5);
}

/** The threshold between background and object: least variance within both (Otsu 1979), with counts damped to their logarithm, so
    that a large background does not decide alone. */
export function threshold(histogram) {
  const { range, counts } = histogram;
  const width = widthOf(histogram);
  const weights = counts.map((count) => Math.log1p(count));
  const total = weights.reduce((a, b) => a + b, 0);
  const moment = weights.reduce((sum, w, i) => sum + w * i, 0);
  let [weight, sum, best, cut] = [0, 0, -1, 0];
  for (let i = 0; i + 1 < weights.length; i += 1) {
    weight += weights[i];
    sum += weights[i] * i;
    if (weight === 0 || weight === total) continue;
    const between = (moment * weight - sum * total) ** 2 / (weight * (total - weight));
    if (between > best) [best, cut] = [between, i + 1];
  }
  return range[0] + width * cut;
}
