// SPDX-License-Identifier: Apache-2.0
// Compares images with snapshots. It does so in a second page of the browser, so that images are decoded and enlarged as in the page of splatd.

/** Runs in the page. Each image is {bytes (base64), type, map}; `map`: a homography by rows that the image is drawn by, or null. */
function prepare() {
  const snapshots = new Map();
  let before = null; // px of the image that was compared last

  const blobOf = async ({ bytes, type }) => (await fetch(`data:${type};base64,${bytes}`)).blob();

  async function pixelsOf(image, [width, height]) {
    const canvas = new OffscreenCanvas(width, height);
    const context = canvas.getContext('2d', { alpha: false });
    context.imageSmoothingQuality = 'low'; // as the page enlarges moving images
    context.drawImage(await createImageBitmap(await blobOf(image)), 0, 0, width, height);
    return context.getImageData(0, 0, width, height).data;
  }

  /** The pixels seen through a homography, by bilinear interpolation; the background beyond the image. */
  function mapped(source, [width, height], map, ground) {
    const result = new Uint8ClampedArray(source.length);
    const [[a, b, c], [d, e, f], [g, h, i]] = map;
    const back = [[e * i - f * h, c * h - b * i, b * f - c * e], [f * g - d * i, a * i - c * g, c * d - a * f], [d * h - e * g, b * g - a * h, a * e - b * d]];
    for (let y = 0; y < height; y += 1) {
      for (let x = 0; x < width; x += 1) {
        const [u, v, w] = back.map(([p, q, r]) => p * (x + 0.5) + q * (y + 0.5) + r);
        const [left, top] = [u / w - 0.5, v / w - 0.5];
        const [column, row] = [Math.floor(left), Math.floor(top)];
        const isInside = column >= 0 && row >= 0 && column + 1 < width && row + 1 < height;
        const at = 4 * (row * width + column);
        for (let k = 0; k < 3; k += 1) {
          const mix = (from) => source[from + k] + (left - column) * (source[from + 4 + k] - source[from + k]);
          result[4 * (y * width + x) + k] = isInside ? mix(at) + (top - row) * (mix(at + 4 * width) - mix(at)) : ground[k];
        }
      }
    }
    return result;
  }

  /** Keeps a snapshot under a name until forget(). */
  async function keep(name, image, size) {
    snapshots.set(name, await pixelsOf(image, size));
  }

  /** Sums of squared differences from a snapshot: over the whole image and over the pixels where the snapshot is not background. `change`: the mean
   * absolute difference of these pixels from the image that was compared before, in levels of 0 to 255. */
  async function compare(image, name, size, ground) {
    const snapshot = snapshots.get(name);
    const plain = await pixelsOf(image, size);
    const shown = image.map ? mapped(plain, size, image.map, ground) : plain;
    const sums = { whole: 0, count: 0, object: 0, covered: 0, change: 0 };
    const last = before?.length === shown.length ? before : shown;
    for (let at = 0; at < snapshot.length; at += 4) {
      let [square, isObject] = [0, false];
      for (let k = 0; k < 3; k += 1) {
        square += (shown[at + k] - snapshot[at + k]) ** 2;
        isObject ||= Math.abs(snapshot[at + k] - ground[k]) > 2;
      }
      sums.whole += square;
      sums.count += 3;
      if (isObject) {
        sums.object += square;
        sums.covered += 3;
        for (let k = 0; k < 3; k += 1) sums.change += Math.abs(shown[at + k] - last[at + k]);
      }
    }
    sums.change /= Math.max(sums.covered, 1);
    before = shown;
    return sums;
  }

  window.judge = { keep, compare, forget: () => { snapshots.clear(); before = null; } };
}

/** Decibels of a sum of squared differences of `count` values. */
export const db = (square, count) => (count ? 10 * Math.log10(255 ** 2 / Math.max(square / count, 1e-4)) : NaN);

/** Sums of several images, and their decibels. */
export class Score {
  #sums = { whole: 0, count: 0, object: 0, covered: 0 };

  add(sums) {
    for (const key of Object.keys(this.#sums)) this.#sums[key] += sums[key];
  }

  get whole() { return db(this.#sums.whole, this.#sums.count); }
  get object() { return db(this.#sums.object, this.#sums.covered); }
}

export class Judge {
  #page; #daemon; #view; #size; #names = new Set();

  /** context: of a browser; daemon: a Daemon of peers.mjs. */
  static async open(context, daemon) {
    const judge = new Judge();
    judge.#page = await context.newPage();
    judge.#daemon = daemon;
    await judge.#page.evaluate(prepare);
    return judge;
  }

  /** The view whose camera moves, and the size of its snapshots [px]. */
  async begin(view, size) {
    [this.#view, this.#size] = [view, size];
    this.#names.clear();
    await this.#page.evaluate(() => window.judge.forget());
  }

  get #ground() { return this.#view.background.slice(0, 3).map((c) => Math.round(255 * c)); }

  /** Compares an image {bytes: Buffer, type, map} with the snapshot of a camera. */
  async compare({ bytes, type, map = null }, camera) {
    const name = JSON.stringify(camera);
    if (!this.#names.has(name)) {
      const snapshot = await this.#daemon.send('POST', '/api/v1/render?format=png', { ...this.#view, size: this.#size, camera: { ...this.#view.camera, ...camera } });
      const image = { bytes: snapshot.bytes.toString('base64'), type: 'image/png' };
      await this.#page.evaluate(([key, one, size]) => window.judge.keep(key, one, size), [name, image, this.#size]);
      this.#names.add(name);
    }
    return this.#page.evaluate(([one, key, size, ground]) => window.judge.compare(one, key, size, ground),
      [{ bytes: bytes.toString('base64'), type, map }, name, this.#size, this.#ground]);
  }
}
