// SPDX-License-Identifier: Apache-2.0
// Reads the container files of camera paths: tar and WebM.

/** Returns [{name, bytes}] of the files in a tar archive (ustar). */
export function untar(bytes) {
  const files = [];
  for (let at = 0; bytes[at];) {
    const text = (from, size) => bytes.toString('latin1', at + from, at + from + size).replace(/[\0 ]+$/, '');
    const size = parseInt(text(124, 12), 8);
    if (text(257, 5) !== 'ustar' || !(size >= 0)) throw new Error(`no header of a tar at byte ${at}`);
    files.push({ name: text(0, 100), bytes: bytes.subarray(at + 512, at + 512 + size) });
    at += 512 + Math.ceil(size / 512) * 512;
  }
  return files;
}

const SEGMENT = 0x18538067;
const CLUSTER = 0x1f43b675;
const BLOCKS = [0xa3, 0xa0]; // SimpleBlock, BlockGroup

/** Returns the number of frames in a WebM file with one track. */
export function countFrames(bytes, from = 0, to = bytes.length) {
  let at = from;
  let count = 0;
  /** Reads a number whose first byte gives its length; an id includes the length marker. */
  const number = (isId) => {
    const size = Math.clz32(bytes[at]) - 23;
    if (size > 8) throw new Error(`no EBML at byte ${at}`);
    let value = isId ? bytes[at] : bytes[at] & (0xff >> size);
    for (let i = 1; i < size; i += 1) value = value * 256 + bytes[at + i];
    at += size;
    return value;
  };
  while (at < to) {
    const id = number(true);
    const size = number(false);
    if (id === SEGMENT || id === CLUSTER) count += countFrames(bytes, at, Math.min(to, at + size));
    else count += Number(BLOCKS.includes(id));
    at += size;
  }
  return count;
}
