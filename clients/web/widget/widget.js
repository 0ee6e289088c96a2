// SPDX-License-Identifier: Apache-2.0
// What anywidget calls in a notebook: <splat-view> with the picture of a widget of the Python package (clients/python/src/splatd/widget.py).
// One file contains it and all that it needs; a notebook loads nothing from elsewhere.
import { parts } from '../app/frames/warp.js';
import * as warp from '../app/parts/warp.js';
import { SplatView } from '../element/splat-view.js';
import { Kernel } from './kernel.js';
import { chooseWay } from './ways.js';

parts.warp = async () => warp;

const REST_MS = 400; // after a final frame: the picture that the notebook keeps
const VIEW_MS = 150; // after a change of the view, before the kernel hears of it
const AGAIN_MS = 1000; // after a lost connection, before the kernel is asked for the way again
const SILENT_MS = 3000; // without an answer of the kernel: the picture says so
const PICTURE_QUALITY = 0.85;

const STYLE = {
  box: 'position: relative; overflow: hidden; max-width: 100%; background: #000',
  view: 'position: absolute; inset: 0; aspect-ratio: auto',
  picture: 'position: absolute; inset: 0; width: 100%; height: 100%; object-fit: contain; margin: 0; max-width: none; background: #000',
  note: 'position: absolute; left: 8px; bottom: 8px; margin: 0; padding: 4px 8px; border-radius: 4px; font: 12px/1.4 system-ui, sans-serif; '
    + 'color: #e6e9ee; background: rgb(18 21 26 / 86%)',
};

function make(name, kind) {
  const element = document.createElement(name);
  element.style.cssText = STYLE[kind];
  return element;
}

/** A function that calls `act` once, `ms` after its last call. stop() forgets the call. */
function later(ms, act) {
  let timer = 0;
  const call = () => {
    clearTimeout(timer);
    timer = setTimeout(act, ms);
  };
  return Object.assign(call, { stop: () => clearTimeout(timer) });
}

/** Each build of the package has an element of its own, so that a page which has loaded an older one shows the newer one as well. */
function elementOf(build) {
  const name = `splat-view-${build}`;
  if (!customElements.get(name)) customElements.define(name, class extends SplatView {});
  return name;
}

/** The view of a widget in one place of the page. */
class Shown {
  #model; #kernel; #view = null; #isEnded = false; #isAsking = false;
  #box = make('div', 'box');
  #picture = make('img', 'picture');
  #note = make('p', 'note');
  #keep = later(REST_MS, () => this.#keepPicture());
  #tellView = later(VIEW_MS, () => this.#view?.view && this.#kernel.tell('view', { view: this.#view.view }));
  #again = later(AGAIN_MS, () => this.#connect());
  #resize = () => this.#layOut();

  constructor(model, el) {
    this.#model = model;
    this.#kernel = new Kernel(model);
    this.#picture.alt = 'The last picture';
    this.#layOut();
    this.#box.append(this.#picture, this.#note);
    this.#box.dataset.lmSuppressShortcuts = 'true'; // JupyterLab: keys turn the picture and leave the cells alone
    this.#box.addEventListener('wheel', (event) => this.#leaveWheel(event), { capture: true, passive: true });
    el.append(this.#box);
    model.on('change:width change:height', this.#resize);
    model.on('change:controls', this.#resize);
    this.#showLast('');
    this.#connect();
  }

  /** The wheel scrolls the notebook until the picture has the focus. */
  #leaveWheel(event) {
    if (!event.ctrlKey && !this.#view?.matches(':focus-within')) event.stopPropagation();
  }

  #layOut() {
    const [width, height] = ['width', 'height'].map((name) => this.#model.get(name));
    Object.assign(this.#box.style, { width, height: height || 'auto', aspectRatio: height ? 'auto' : this.#model.get('_aspect') });
    if (this.#view) this.#view.controls = this.#model.get('controls');
  }

  #showLast(text) {
    const picture = this.#model.get('_picture');
    if (picture?.byteLength) {
      URL.revokeObjectURL(this.#picture.src);
      this.#picture.src = URL.createObjectURL(new Blob([picture]));
    }
    this.#picture.hidden = !picture?.byteLength;
    this.#say(text);
  }

  #say(text) {
    this.#note.textContent = text;
    this.#note.hidden = !text;
  }

  /** Asks the kernel how the picture is reached, and shows it. */
  async #connect() {
    if (this.#isAsking || this.#isEnded) return;
    this.#isAsking = true;
    const timer = setTimeout(() => {
      this.#drop();
      this.#showLast('The kernel does not answer. This is the last picture.');
    }, SILENT_MS);
    const welcome = await this.#kernel.hello();
    clearTimeout(timer);
    this.#isAsking = false;
    if (this.#isEnded) return;
    try {
      if (welcome.error) throw new Error(welcome.error);
      const way = await chooseWay(welcome);
      this.#kernel.tell('used', { transport: `${way.url ? 'websocket' : 'kernel'}: ${way.why}` });
      if (!this.#isEnded) this.#show(welcome, way.url);
    } catch (error) {
      this.#kernel.tell('used', { transport: `none: ${error.message}` });
      this.#showLast(error.message);
    }
  }

  #show({ session, token }, url) {
    this.#drop();
    const view = /** @type {SplatView} */ (document.createElement(elementOf(this.#model.get('_build'))));
    view.style.cssText = STYLE.view;
    view.session = session;
    view.controls = this.#model.get('controls');
    if (url) Object.assign(view, { url, token });
    else view.transport = this.#kernel.transport;
    view.addEventListener('frame', (/** @type {CustomEvent} */ { detail }) => {
      this.#picture.hidden = true;
      this.#say('');
      if (detail.isFinal) this.#keep();
      else this.#keep.stop();
    });
    view.addEventListener('viewchange', () => this.#tellView());
    view.addEventListener('error', () => {
      if (view === this.#view && ['lost', 'refused'].includes(view.state)) this.#again(); // the session may be gone, or the kernel
    });
    this.#view = view;
    this.#box.prepend(view);
  }

  #drop() {
    this.#keep.stop();
    this.#view?.remove();
    this.#view = null;
  }

  /** Gives the shown picture to the model, so that the notebook has it without a kernel. */
  async #keepPicture() {
    const blob = await this.#view?.toBlob('image/webp', PICTURE_QUALITY);
    if (!blob || this.#isEnded) return;
    this.#model.set('_picture', new DataView(await blob.arrayBuffer()));
    this.#model.save_changes();
  }

  end() {
    if (this.#isEnded) return;
    this.#isEnded = true;
    this.#tellView.stop();
    this.#again.stop();
    this.#drop();
    this.#kernel.bye();
    this.#model.off('change:width change:height', this.#resize);
    this.#model.off('change:controls', this.#resize);
    URL.revokeObjectURL(this.#picture.src);
    this.#box.remove();
  }
}

export default {
  render({ model, el }) {
    const shown = new Shown(model, el);
    const leave = () => shown.end();
    window.addEventListener('pagehide', leave);
    return () => {
      window.removeEventListener('pagehide', leave);
      leave();
    };
  },
};
