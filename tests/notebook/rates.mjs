// SPDX-License-Identifier: Apache-2.0
// Frames per second and the time from the hand to the picture in JupyterLab, while the mouse turns the engine at 512 x 384 px: of the widget by
// both ways, of jupyter_rfb with the same pictures (drawn before, so that only their way counts), and of K3D, which draws in the browser.
// node rates.mjs FILE.csv [WAY]; build/notebook needs jupyter_rfb and k3d as well. A measurement, not a test.
import { writeFileSync } from 'node:fs';
import { cpus } from 'node:os';
import { setTimeout } from 'node:timers/promises';
import { launch } from '../web/support/browser.mjs';
import { Lab, run, type, until } from './lab.mjs';

const MOVES = 180;
const MOVE_MS = 16;
const REPEATS = 2;
const BEGIN = 'import splatd, numpy as np\nvolume = splatd.start(backend="cpu").load("demo:engine")\nview = volume.view(size=(512, 384))';
const RFB = `import jupyter_rfb
pictures = [view.with_camera(azimuth=a).render().array[:, :, :3].copy() for a in range(0, 360, 10)]
class Player(jupyter_rfb.RemoteFrameBuffer):
    x = 0
    def handle_event(self, event):
        if event["event_type"] in ("pointer_move", "move"):
            self.x = int(event["x"])
            self.request_draw()
    def get_frame(self):
        picture = pictures[self.x // 4 % len(pictures)].copy()
        picture[:32, :32] = self.x // 16 * 8 + 4  # the position, readable after JPEG
        picture[:32, 32:64] = self.x % 16 * 16 + 8
        return picture
player = Player(css_width="512px", css_height="384px", resizable=False)
player`;
const K3D = `import k3d
samples = np.stack([volume.slice("z", index=i).array for i in range(volume.shape[0])]).astype("f4")
plot = k3d.plot(height=384, grid_visible=False, camera_auto_fit=True)
plot += k3d.volume(samples, color_range=[40, 255], samples=512)
plot`;

/** Runs in the page: records {at, hand} of each picture in window.pictures; hand: when the mouse was where the picture shows it. */
function record(kind) {
  window.pictures = [];
  window.hands = new Map();
  let last = 0;
  const output = document.querySelectorAll('.jp-CodeCell')[1].querySelector('.jp-OutputArea');
  const all = (root) => [...root.querySelectorAll('*')];
  if (kind === 'splatd') {
    const view = all(output).find(({ localName }) => localName.startsWith('splat-view-'));
    view.addEventListener('frame', ({ detail: { latency } }) => {
      const at = performance.now();
      if (latency !== null) window.pictures.push({ at, hand: at - latency });
    });
    return view.getBoundingClientRect().toJSON();
  }
  if (kind === 'rfb') {
    const image = all(output).find((one) => one.localName === 'img' || one.localName === 'canvas' || one.shadowRoot);
    const found = image.shadowRoot ? image.shadowRoot.querySelector('img') : image;
    const box = found.getBoundingClientRect();
    window.addEventListener('pointermove', ({ clientX }) => window.hands.set(Math.floor(clientX - box.left), performance.now()), { capture: true });
    const small = new OffscreenCanvas(64, 32).getContext('2d', { willReadFrequently: true });
    found.addEventListener('load', () => {
      small.drawImage(found, 0, 0, 64, 32, 0, 0, 64, 32);
      const [high] = small.getImageData(16, 16, 1, 1).data;
      const [low] = small.getImageData(48, 16, 1, 1).data;
      window.pictures.push({ at: performance.now(), hand: window.hands.get(Math.floor(high / 8) * 16 + Math.floor(low / 16)) });
    });
    return box.toJSON();
  }
  const canvas = all(output).filter(({ localName }) => localName === 'canvas').sort((a, b) => b.width - a.width)[0];
  window.addEventListener('pointermove', () => { last = performance.now(); }, { capture: true });
  let isPending = false;
  for (const name of ['drawArrays', 'drawElements', 'drawElementsInstanced', 'drawArraysInstanced']) {
    const before = WebGL2RenderingContext.prototype[name];
    WebGL2RenderingContext.prototype[name] = function draw(...values) {
      before.apply(this, values);
      if (isPending || !last) return;
      isPending = true;
      const hand = last;
      setTimeout(() => {
        this.readPixels(0, 0, 1, 1, this.RGBA, this.UNSIGNED_BYTE, new Uint8Array(4)); // waits until it is drawn
        isPending = false;
        window.pictures.push({ at: performance.now(), hand });
      });
    };
  }
  return canvas.getBoundingClientRect().toJSON();
}

const quantile = (values, part) => [...values].sort((a, b) => a - b)[Math.min(values.length - 1, Math.floor(part * values.length))];

async function measure(page, name, kind, code) {
  await type(page, 1, code);
  await run(page, 1);
  const box = await until(`${name} shows`, () => page.evaluate(record, kind));
  await setTimeout(1500);
  const rows = [];
  for (let repeat = 0; repeat < REPEATS; repeat += 1) {
    await page.evaluate(() => { window.pictures.length = 0; });
    await page.mouse.move(box.x + 100, box.y + 190);
    await page.mouse.down();
    const end = Date.now() + 2 * MOVES * MOVE_MS;
    for (let i = 0; i < MOVES && Date.now() < end; i += 1) {
      const next = setTimeout(MOVE_MS);
      await page.mouse.move(box.x + 100 + i, box.y + 190);
      await next;
    }
    const pictures = await page.evaluate(() => window.pictures.slice());
    await page.mouse.up();
    const lags = pictures.filter(({ hand }) => hand).map(({ at, hand }) => at - hand);
    const seconds = (pictures.at(-1).at - pictures[0].at) / 1000;
    rows.push([name, repeat, pictures.length, ((pictures.length - 1) / seconds).toFixed(1), quantile(lags, 0.5)?.toFixed(0), quantile(lags, 0.95)?.toFixed(0)]);
    console.log(rows.at(-1).join());
    await setTimeout(1000);
  }
  return rows;
}

const lab = await Lab.start();
const browser = await launch();
const rows = [['way', 'repeat', 'pictures', 'per_second', 'hand_ms_median', 'hand_ms_95']];
try {
  const page = await (await browser.newContext({ viewport: { width: 1100, height: 900 } })).newPage();
  lab.write('rates.ipynb', [BEGIN, 'None']);
  await lab.open(page, 'rates.ipynb');
  await run(page, 0);
  for (const [name, kind, code] of [
    ['widget, WebSocket', 'splatd', 'view.show(transport="websocket")'], ['widget, kernel', 'splatd', 'view.show(transport="kernel")'],
    ['jupyter_rfb', 'rfb', RFB], ['K3D', 'k3d', K3D],
  ].filter(([name]) => !process.argv[3] || name === process.argv[3])) {
    try {
      rows.push(...await measure(page, name, kind, code));
    } catch (error) {
      console.log(`${name}: ${error.message}`);
    }
    if (process.env.SPLATD_SHOTS_DIR) await page.screenshot({ path: `${process.env.SPLATD_SHOTS_DIR}/rates-${kind}.png` });
  }
} finally {
  await browser.close();
  await lab.stop();
}
if (process.argv[2]) writeFileSync(process.argv[2], `# ${cpus().length} processors, ${cpus()[0].model}\n${rows.map((row) => row.map((cell) => (/,/.test(cell) ? `"${cell}"` : cell)).join()).join('\n')}\n`);
