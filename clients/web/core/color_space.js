// SPDX-License-Identifier: Apache-2.0
// The colour spaces in which ParaView interpolates colour maps: CIELAB (D65), HSV, and Moreland's Msh for diverging maps
// (Moreland, Diverging Color Maps for Scientific Visualization, 2009).

const D65 = [0.9505, 1, 1.089];
const linear = (c) => (c > 0.04045 ? ((c + 0.055) / 1.055) ** 2.4 : c / 12.92);
const display = (c) => (c > 0.0031308 ? 1.055 * c ** (1 / 2.4) - 0.055 : 12.92 * c);
const hold = (c) => Math.min(1, Math.max(0, c));
const lerp = (a, b, t) => a.map((part, k) => part + (b[k] - part) * t);

export function labFromRgb(rgb) {
  const [r, g, b] = rgb.map(linear);
  const [x, y, z] = [0.4124 * r + 0.3576 * g + 0.1805 * b, 0.2126 * r + 0.7152 * g + 0.0722 * b, 0.0193 * r + 0.1192 * g + 0.9505 * b]
    .map((part, k) => part / D65[k]).map((part) => (part > 0.008856 ? Math.cbrt(part) : 7.787 * part + 16 / 116));
  return [116 * y - 16, 500 * (x - y), 200 * (y - z)];
}

export function rgbFromLab([l, a, b]) {
  const y = (l + 16) / 116;
  const [x, yy, z] = [y + a / 500, y, y - b / 200].map((part) => (part ** 3 > 0.008856 ? part ** 3 : (part - 16 / 116) / 7.787))
    .map((part, k) => part * D65[k]);
  return [3.2406 * x - 1.5372 * yy - 0.4986 * z, -0.9689 * x + 1.8758 * yy + 0.0415 * z, 0.0557 * x - 0.204 * yy + 1.057 * z].map(display).map(hold);
}

const mshFromLab = ([l, a, b]) => {
  const m = Math.hypot(l, a, b);
  return [m, m > 0.001 ? Math.acos(l / m) : 0, Math.hypot(a, b) > 0.001 ? Math.atan2(b, a) : 0];
};
const labFromMsh = ([m, s, h]) => [m * Math.cos(s), m * Math.sin(s) * Math.cos(h), m * Math.sin(s) * Math.sin(h)];

/** The hue of a colour without saturation beside a saturated one of magnitude m: it spins away from purple. */
function spin([m, s, h], unsaturated) {
  if (m >= unsaturated - 0.1) return h;
  const angle = s * Math.sqrt(Math.max(0, unsaturated * unsaturated - m * m)) / (m * Math.sin(s));
  return h > -0.3 * Math.PI ? h + angle : h - angle;
}

function diverging(first, second, t) {
  let [one, two] = [mshFromLab(labFromRgb(first)), mshFromLab(labFromRgb(second))];
  const turn = Math.abs(one[2] - two[2]);
  if (one[1] > 0.05 && two[1] > 0.05 && Math.min(turn, 2 * Math.PI - turn) > Math.PI / 3) { // two saturated, distinct colours: white lies between
    const middle = Math.max(one[0], two[0], 88);
    if (t < 0.5) [two, t] = [[middle, 0, 0], 2 * t];
    else [one, t] = [[middle, 0, 0], 2 * t - 1];
  }
  if (one[1] < 0.05 && two[1] > 0.05) one = [one[0], one[1], spin(two, one[0])];
  else if (two[1] < 0.05 && one[1] > 0.05) two = [two[0], two[1], spin(one, two[0])];
  return rgbFromLab(labFromMsh(lerp(one, two, t)));
}

function hsvFromRgb([r, g, b]) {
  const most = Math.max(r, g, b);
  const span = most - Math.min(r, g, b);
  if (span === 0) return [0, 0, most];
  const sector = most === r ? ((g - b) / span + 6) % 6 : most === g ? (b - r) / span + 2 : (r - g) / span + 4;
  return [sector / 6, span / most, most];
}

const rgbFromHsv = ([h, s, v]) => [5, 3, 1].map((n) => {
  const k = (n + h * 6) % 6;
  return v - v * s * Math.max(0, Math.min(k, 4 - k, 1));
});

function hsv(first, second, t, wraps) {
  const [one, two] = [hsvFromRgb(first), hsvFromRgb(second)];
  if (wraps && Math.abs(two[0] - one[0]) > 0.5) two[0] += two[0] < one[0] ? 1 : -1;
  const mixed = lerp(one, two, t);
  return rgbFromHsv([(mixed[0] + 1) % 1, mixed[1], mixed[2]]);
}

/** How each colour space of ParaView mixes two colours: (first, second, t in [0, 1]) → [r, g, b]. */
export const MIXES = Object.freeze({
  RGB: lerp,
  HSV: (a, b, t) => hsv(a, b, t, true),
  HSVNoWrap: (a, b, t) => hsv(a, b, t, false),
  Lab: (a, b, t) => rgbFromLab(lerp(labFromRgb(a), labFromRgb(b), t)),
  CIELAB: (a, b, t) => rgbFromLab(lerp(labFromRgb(a), labFromRgb(b), t)),
  Diverging: diverging,
  Step: (a) => a,
});
