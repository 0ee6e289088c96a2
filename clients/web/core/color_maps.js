// SPDX-License-Identifier: Apache-2.0
// Perceptual colour maps, as 33 equally spaced colours each. The tables come from d3-scale-chromatic 3.1.0 (ISC), which takes blue-red from
// ColorBrewer (Apache-2.0) and turbo from Google (Apache-2.0); clients/web/LICENSES.md has the texts. Between the colours the daemon interpolates
// linearly, at most 5/255 off the original.

const TABLES = {
  viridis: '440154470d6048186a482374472d7b4537814240863e49893b528b375b8d33638d2f6b8e2c728e297a8e26828e23898e21918c1f988b1fa08822a785'
    + '28ae8032b67a3fbc734ec36b5ec96270cf5784d44b98d83eaddc30c2df23d8e219ece51bfde725',
  inferno: '0000040403120b0724150b37210c4a2f0a5b3d09654a0c6b57106e64156e71196e7d1e6d8a226a972766a32c61b0315bbc3754c73e4cd24644db503b'
    + 'e45a31eb6628f1731df68013f98e09fb9d07fcac11fbbc21f9cb35f5db4cf2ea69f3f68afcffa4',
  cividis: '00205100265d012b6508316911366c1c3c6e26426e31476e3c4d6e47536d51586e5a5e6e62646f6a6a707270717976737f7c758682768c8877938e78'
    + '9a9478a19b78a9a177b2a874bbaf71c5b66dcebd68d8c462e2cb5cebd355f3da4ffae249fdea45',
  turbo: '23171b3e2a71493eae4a53d74569ee3c7ff83295f72ba9ef26bce125cdcf29dcbc32e9a73ff39350f98065fd6e7cfd5e95fb51adf545c5ec3cdae034'
    + 'ecd12efac029ffad24ff9821ff821dfd6c1af05616df4111cb2f0db61f07a31302950c00900c00',
  'blue-red': '0530610e417817518e2061a02a71ae367fb8448ec1569dc86bacd082bad898c7dfadd2e5bfdcebd0e4efdeebf2e9eff2f2efeef7ece5fae4d8fbd9c7'
    + 'faccb4f7bca0f3aa8cec977ae48268db6d59d1574bc6413fb82d35a81d2d9411277e082367001f',
  grey: '0000007f7f7fffffff',
};

/** The names of the maps in TABLES, in the order of the page. */
export const MAP_NAMES = Object.freeze(Object.keys(TABLES));
export const STEPS_MAX = 32;

const TOLERANCE = 3 / 255;
const EDGE = 1e-4; // width of the edge between two steps, as a share of the range

const parse = (table) => Array.from({ length: table.length / 6 }, (_, i) => [0, 2, 4].map((k) => parseInt(table.substr(i * 6 + k, 2), 16) / 255));
const lerp = (a, b, t) => a.map((part, k) => part + (b[k] - part) * t);

/** The stops [[t, [r, g, b]], …] of a map, t in [0, 1] rising. */
export const tableOf = (name) => parse(TABLES[name]).map((color, i, all) => [i / (all.length - 1), color]);

/** The colour of rising stops at t: linear between them, constant outside. */
export function colorOfStops(stops, t) {
  const next = stops.findIndex(([at]) => at > t);
  if (next < 0) return stops.at(-1)[1];
  if (next === 0) return stops[0][1];
  const [[a, first], [b, second]] = [stops[next - 1], stops[next]];
  return lerp(first, second, (t - a) / (b - a));
}

/** The stop between two others that lies farthest from the line through them, or -1 if all are closer than the tolerance. */
function farthest(stops, from, to, tolerance) {
  const [[a, first], [b, last]] = [stops[from], stops[to]];
  let [worst, at] = [tolerance, -1];
  for (let i = from + 1; i < to; i += 1) {
    const line = lerp(first, last, (stops[i][0] - a) / (b - a));
    const error = Math.max(...line.map((part, k) => Math.abs(part - stops[i][1][k])));
    if (error > worst) [worst, at] = [error, i];
  }
  return at;
}

/** Drops stops that lie on the line between others (Douglas and Peucker 1973, with the largest error of a channel). */
export function simplify(stops, tolerance = TOLERANCE) {
  if (stops.length < 3) return stops;
  const kept = new Set([0, stops.length - 1]);
  const open = [[0, stops.length - 1]];
  while (open.length) {
    const [from, to] = open.pop();
    const at = farthest(stops, from, to, tolerance);
    if (at < 0) continue;
    kept.add(at);
    open.push([from, at], [at, to]);
  }
  return stops.filter((_, i) => kept.has(i));
}

/** The stops of {name, table, isReversed, steps}: `table` replaces the table of this name; steps = 0 gives a continuous map. */
export function stopsOf({ name, table = null, isReversed = false, steps = 0 }) {
  const own = table ?? tableOf(name);
  const stops = isReversed ? own.map(([t, color]) => [1 - t, color]).reverse() : own;
  if (!steps) {
    const few = simplify(stops);
    return few.length > 2 ? few : stops; // three colours tell a map (map_finder.js)
  }
  return Array.from({ length: steps }, (_, i) => {
    const color = colorOfStops(stops, steps > 1 ? i / (steps - 1) : 0.5);
    return [[i === 0 ? 0 : i / steps + EDGE, color], [i + 1 === steps ? 1 : (i + 1) / steps - EDGE, color]];
  }).flat();
}
