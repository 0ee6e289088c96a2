// SPDX-License-Identifier: Apache-2.0
// The values of a slice, as the daemon answers them (format=raw), and how they become colours.
import { colorOfStops, tableOf } from './color_maps.js';

const ARRAYS = {
  uint8: Uint8Array, int8: Int8Array, uint16: Uint16Array, int16: Int16Array, int32: Int32Array, float32: Float32Array, float64: Float64Array,
};

/** {meta, values}: `meta` is the header X-Slice. Throws if they do not belong together. */
export function readSlice(header, bytes) {
  const meta = JSON.parse(header ?? 'null');
  const Values = ARRAYS[meta?.type];
  const count = meta?.shape?.[0] * meta?.shape?.[1];
  if (!Values || meta.endianness !== 'little' || bytes.byteLength !== count * Values.BYTES_PER_ELEMENT) {
    throw new RangeError('the answer is not a slice');
  }
  return { meta, values: new Values(bytes) };
}

/** The value at a pixel of a slice; NaN outside of the volume. */
export const valueAt = ({ meta, values }, { column, row }) => values[row * meta.shape[0] + column];

const SHADES = 256;

/** The colours of the values of a window from its lower end to its upper one, as RGBA of little-endian 32-bit pixels. colorAt(t): red, green and blue at t in [0, 1]. */
export const shadesOf = (colorAt) => Uint32Array.from({ length: SHADES }, (_, i) => {
  const [red, green, blue] = colorAt(i / (SHADES - 1)).map((part) => Math.round(255 * Math.min(1, Math.max(0, part))));
  return (0xff000000 | blue << 16 | green << 8 | red) >>> 0;
});

/** The shades of grey. */
export const GREYS = shadesOf((at) => [at, at, at]);

/**
 * How a view shows the values of slices: {window: {center, width}, shades}. colors: `slices.colors` of the view; points: of its transfer function,
 * whose opacity does not count.
 */
export function lookOf(colors, window, points) {
  if (colors === 'transfer_function') {
    const [low, high] = [points[0].value, points.at(-1).value];
    const width = high > low ? high - low : 1;
    const stops = points.map(({ value, color }) => [value, color]);
    return { window: { center: low / 2 + high / 2, width }, shades: shadesOf((at) => colorOfStops(stops, low + at * width)) };
  }
  return { window, shades: colors === 'grey' ? GREYS : shadesOf((at) => colorOfStops(tableOf(colors), at)) };
}

/** Adds the light of several channels [{values, window: {center, width}, shades}, …], all of one size. NaN adds nothing. */
export function paintChannels(channels, pixels) {
  const bytes = new Uint8ClampedArray(pixels.buffer, pixels.byteOffset, 4 * pixels.length);
  pixels.fill(0xff000000);
  for (const { values, window: { center, width }, shades } of channels) {
    const factor = SHADES / width;
    const offset = (width / 2 - center) * factor;
    const parts = new Uint8Array(shades.buffer);
    for (let i = 0; i < values.length; i++) {
      const value = values[i] * factor + offset;
      if (value !== value) continue;
      const at = 4 * (value > 0 ? value >= SHADES - 1 ? SHADES - 1 : value | 0 : 0);
      for (let c = 0; c < 3; c++) bytes[4 * i + c] += parts[at + c];
    }
  }
}

/** Writes the values as RGBA of little-endian 32-bit pixels: shades of the window {center, width}; NaN is transparent. */
export function paintSlice(values, { center, width }, pixels, shades = GREYS) {
  const factor = 256 / width;
  const offset = (width / 2 - center) * factor;
  for (let i = 0; i < values.length; i++) {
    const value = values[i] * factor + offset;
    const grey = value <= 0 ? 0 : value >= 255 ? 255 : value | 0;
    pixels[i] = value === value ? shades[grey] : 0;
  }
}

/** The daemon's default window: of all values but half a percent at each end of the histogram {counts, range}. */
export function defaultWindow({ counts, range: [low, high] }) {
  const total = counts.reduce((a, b) => a + b, 0);
  const bin = (high - low) / counts.length;
  let below = 0;
  let first = -1;
  let end = counts.length;
  for (let i = 0; i < counts.length; i++) {
    below += counts[i];
    if (first < 0 && below > 0.005 * total) first = i;
    if (below >= 0.995 * total) {
      end = i + 1;
      break;
    }
  }
  first = Math.max(first, 0);
  return { center: low + bin * (first + end) / 2, width: bin * (end - first) || 1 };
}
