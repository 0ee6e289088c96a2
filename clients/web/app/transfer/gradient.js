// SPDX-License-Identifier: Apache-2.0
// The gradient axis of the transfer function: a factor on the opacity by gradient magnitude, over the joint histogram of values
// (upwards) and gradient magnitudes (to the right).
import { readHistogram } from '../../core/histogram.js';
import { GRADIENT_POINTS_MAX, curveOf, gradientOf, leastGap } from '../../core/transfer.js';
import { t } from '../../core/text.js';
import { Curve } from '../controls/curve.js';
import { byId, setText } from '../controls/dom.js';
import { themeColor } from '../shell/theme.js';

const INK = 0.6; // lifts rare bins, which are the edges
const FACTOR_MAX = 0.999; // the height at which a curve draws the factor 1
const parse = (color) => {
  const context = new OffscreenCanvas(1, 1).getContext('2d');
  context.fillStyle = color;
  context.fillRect(0, 0, 1, 1);
  return context.getImageData(0, 0, 1, 1).data;
};

export function install({ transfer, connection }) {
  new GradientPanel(transfer, { load: (isJoint) => connection.api.histogram(connection.session.id, connection.session.token, isJoint) });
}

class GradientPanel {
  #transfer; #load; #curve;
  #joint = null;
  #image = null; // the histogram as a picture of one px per bin
  #ink = '';
  #asked = null;
  #problem = '';

  constructor(transfer, { load }) {
    this.#transfer = transfer;
    this.#load = load;
    this.#curve = new Curve(byId('gradient-curve'), {
      edit: (points, how) => transfer.edit({ gradient: this.#withOrigin(gradientOf(points)) }, how), limit: GRADIENT_POINTS_MAX - 1,
      name: 'gradient', seal: () => transfer.seal(),
    });
    byId('gradient-off').addEventListener('click', ({ timeStamp }) => transfer.edit({ gradient: [] }, { time: timeStamp }));
    byId('gradient').addEventListener('toggle', () => this.show());
    transfer.onShow(() => this.show());
  }

  // A single point would be a constant factor, so the first one comes with a point at magnitude 0.
  #withOrigin(gradient) {
    if (this.#transfer.state.gradient.length > 0 || gradient.length !== 1 || gradient[0].magnitude === 0) return gradient;
    return [{ magnitude: 0, scale: gradient[0].scale < 0.5 ? 1 : 0 }, gradient[0]];
  }

  async #ask() {
    const { volume } = this.#transfer;
    if (this.#asked === volume) return;
    this.#asked = volume;
    this.#joint = this.#image = null;
    this.#problem = '';
    this.#curve.showAll();
    try {
      const joint = readHistogram(await this.#load(true));
      if (this.#asked !== volume) return;
      if (joint.volume === volume) this.#joint = joint;
      else this.#problem = t('transfer.othervolume');
      this.#ink = '';
    } catch (error) {
      this.#problem = error.message;
    }
    this.show();
  }

  get #extent() {
    const { gradient } = this.#transfer.state;
    return [0, Math.max(this.#joint?.y.range[1] ?? 0, gradient.at(-1)?.magnitude ?? 0) || 1];
  }

  show() {
    if (!this.#transfer.state || !byId('gradient').open || !byId('transfer').open) return;
    this.#ask();
    const { isEditable } = this.#transfer;
    const { gradient } = this.#transfer.state;
    byId('gradient-off').disabled = gradient.length === 0;
    setText(byId('gradient-note'), this.#problem ? t('transfer.nohistogram', { reason: this.#problem }) : '');
    byId('gradient-note').hidden = !this.#problem;
    this.#curve.show({
      points: curveOf(gradient), extent: this.#extent, gap: leastGap(this.#extent), isEditable, mode: 'gradient',
      paint: (...where) => this.#paint(gradient, ...where),
    });
  }

  #draw(ink) {
    const { x, y, counts } = this.#joint;
    const [red, green, blue] = parse(ink);
    const image = new ImageData(y.bins, x.bins);
    const most = Math.log1p(counts.reduce((a, b) => Math.max(a, b), 1));
    counts.forEach((count, i) => {
      const [value, gradient] = [i % x.bins, Math.floor(i / x.bins)];
      image.data.set([red, green, blue, 255 * (Math.log1p(count) / most) ** INK], 4 * ((x.bins - 1 - value) * y.bins + gradient));
    });
    this.#image = new OffscreenCanvas(y.bins, x.bins);
    this.#image.getContext('2d').putImageData(image, 0, 0);
    this.#ink = ink;
  }

  #paint(gradient, context, width, height, [low, high]) {
    const xOf = (value) => (value - low) / (high - low) * width;
    const ink = themeColor('--dots');
    if (this.#joint) {
      if (ink !== this.#ink) this.#draw(ink);
      context.imageSmoothingEnabled = true;
      const [from, to] = this.#joint.y.range.map(xOf);
      context.drawImage(this.#image, from, 0, to - from, height);
    }
    const yOf = (scale) => height * (1 - Math.min(scale, FACTOR_MAX));
    context.beginPath();
    if (gradient.length === 0) {
      context.setLineDash([4, 4]);
      context.moveTo(0, 1);
      context.lineTo(width, 1);
    } else {
      context.moveTo(Math.min(0, xOf(gradient[0].magnitude)), yOf(gradient[0].scale));
      for (const { magnitude, scale } of gradient) context.lineTo(xOf(magnitude), yOf(scale));
      context.lineTo(width, yOf(gradient.at(-1).scale));
    }
    context.strokeStyle = themeColor('--text');
    context.lineWidth = 1.5;
    context.stroke();
    context.setLineDash([]);
  }
}
