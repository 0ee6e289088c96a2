// SPDX-License-Identifier: Apache-2.0
// The values of a slice, as the daemon answers them (format=raw), and how they become grey.

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

/** Writes the values as RGBA of little-endian 32-bit pixels: grey in the window {center, width}; NaN is transparent. */
export function paintSlice(values, { center, width }, pixels) {
  const factor = 256 / width;
  const offset = (width / 2 - center) * factor;
  for (let i = 0; i < values.length; i++) {
    const value = values[i] * factor + offset;
    const grey = value <= 0 ? 0 : value >= 255 ? 255 : value | 0;
    pixels[i] = value === value ? 0xff000000 | grey << 16 | grey << 8 | grey : 0;
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
