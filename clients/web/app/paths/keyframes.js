// SPDX-License-Identifier: Apache-2.0
// The panel "Path": edits the keyframes of a camera path, plays the path in the view, and sends it to the daemon.
import {
  EMPTY, KEYS_MAX, SECONDS, append, appendTurn, framesOf, isWhole, keyOf, lengthOf, move, pointerInto, remove, replace, requestOf,
  secondsAt, stretch, turnOf, uprightAxis, viewAt,
} from '../../core/keyframes.js';
import { t } from '../../core/text.js';
import { ask } from '../controls/ask.js';
import { byId, make, setText } from '../controls/dom.js';
import { showValue } from '../controls/fields.js';
import { pathApi } from './paths.js';
import { THUMBNAIL } from '../frames/screen.js';

const EASES = ['linear', 'smooth', 'step'];
const LOSSLESS = ['png', 'exr'];
const seconds = (value) => t('path.seconds', { value: Number(value.toFixed(2)) });

export function install(app) {
  const { viewer, screen, storage, panel, notice, paths, warp } = app;
  const keyframes = new Keyframes(viewer, {
    screen, thumbnail: () => (warp?.isVisible && pathApi(app) ? null : screen.thumbnail()), api: () => pathApi(app), storage, made: (path) => paths.add(path),
    complain: (pointer, text) => panel.complain(pointer, text) || notice.show(text, 'warning'),
  });
  viewer.on('view', () => keyframes.show());
  screen.onResize(() => keyframes.show());
}

class Keyframes {
  #viewer; #screen; #thumbnail; #api; #storage; #complain; #tellMade;
  #path = EMPTY;
  #volume = null;
  #player = null; // set while the path plays
  #isSending = false;

  /**
   * thumbnail(): an image of the current view, or null if the canvas shows another camera (warp.js) and the daemon can draw it;
   * api(): the daemon's interface, or null if this client may not create paths; storage: {recall(key), remember(key, text)};
   * complain(pointer, text) shows an error beside its control; made(path) reports a path that the daemon accepted.
   */
  constructor(viewer, { screen, thumbnail, api, storage, complain, made }) {
    this.#viewer = viewer;
    this.#screen = screen;
    this.#thumbnail = thumbnail;
    this.#api = api;
    this.#storage = storage;
    this.#complain = complain;
    this.#tellMade = made;
    const press = (id, act) => byId(id).addEventListener('click', act);
    press('key-add', () => this.#addKey());
    press('turn-add', () => this.#addTurn());
    press('keys-clear', () => this.#clear());
    press('path-play', () => (this.#player ? this.#stop() : this.#play()));
    byId('path-loop').addEventListener('change', ({ target }) => this.#setPath({ ...this.#path, isLoop: target.checked }));
    byId('path-length').addEventListener('change', ({ target }) => this.#setPath(stretch(this.#path, target.valueAsNumber)));
    byId('path-at').addEventListener('input', ({ target, timeStamp }) => {
      this.#stop();
      this.#seek(target.valueAsNumber, timeStamp);
    });
    for (const id of ['path-width', 'path-height', 'path-fps', 'path-format', 'path-quality']) byId(id).addEventListener('input', () => this.#update());
    byId('path-form').addEventListener('submit', (event) => {
      event.preventDefault();
      this.#render();
    });
  }

  /** Follows the view. Each volume has a path of its own, which the tab remembers. */
  show() {
    const { view, canControl } = this.#viewer;
    for (const button of byId('keys').querySelectorAll('.picture')) button.disabled = !canControl;
    if (view && view.volume !== this.#volume) {
      this.#stop();
      this.#volume = view.volume;
      this.#path = this.#restore();
      this.#rebuild();
    }
    this.#update();
  }

  #restore() {
    try {
      const path = JSON.parse(this.#storage.recall(`path:${this.#volume}`));
      return path?.keys ? path : EMPTY;
    } catch {
      return EMPTY; // an unreadable entry counts as missing
    }
  }

  // The path.

  /** {view, picture} of the current view. */
  get #currentView() {
    return { view: this.#viewer.view, picture: this.#thumbnail() };
  }

  #addKey() {
    const current = this.#currentView;
    this.#setPath(append(this.#path, keyOf(current)));
    if (!current.picture) this.#addThumbnail(current.view);
  }

  async #addTurn() {
    const { camera, box, view } = this.#viewer;
    const { value } = byId('turn-axis');
    const axis = value === 'screen' ? camera.up : value === 'upright' ? uprightAxis(camera, box.half) : box.half[Number(value)];
    const turned = turnOf(view, axis).slice(1).map((other) => keyOf({ view: other }));
    const current = this.#currentView;
    this.#setPath(appendTurn(this.#path, [keyOf(current), ...turned]));
    for (const { view: other } of current.picture ? turned : [current, ...turned]) await this.#addThumbnail(other); // one image at a time
  }

  /** Requests a thumbnail for the key of a view that the canvas does not show; without one the key shows its number. */
  async #addThumbnail(view) {
    try {
      const reader = new FileReader();
      reader.readAsDataURL(await this.#api().still(view, THUMBNAIL));
      await new Promise((resolve) => { reader.onload = resolve; });
      const i = this.#path.keys.findIndex((key) => key.view === view);
      if (i < 0) return;
      this.#path = replace(this.#path, i, { picture: reader.result });
      this.#keep();
      byId('keys').children[i].querySelector('.picture').prepend(make('img', { src: reader.result, alt: '' }));
    } catch { /* the daemon is busy, or the image quota is used up */ }
  }

  #keep() {
    this.#storage.remember(`path:${this.#volume}`, JSON.stringify(this.#path));
  }

  async #clear() {
    const { keys } = this.#path;
    if (keys.length > 1 && !await ask(t('path.clear.ask', { count: keys.length }), t('common.remove'))) return;
    this.#setPath(EMPTY);
    byId('key-add').focus();
  }

  #setPath(path) {
    this.#stop();
    const isList = path.keys.length !== this.#path.keys.length || path.isLoop !== this.#path.isLoop
      || path.keys.some(({ view, picture }, i) => view !== this.#path.keys[i].view || picture !== this.#path.keys[i].picture);
    this.#path = path;
    this.#keep();
    if (isList) this.#rebuild();
    this.#update();
  }

  // The list.

  /** Rebuilds the list when keys are added, removed or moved. */
  #rebuild() {
    byId('keys').replaceChildren(...this.#path.keys.map((key, i) => this.#entry(key, i)));
  }

  /** Changes the path by the button `name` of a key and moves the focus to the same button of key i. */
  #changeAndFocus(path, i, name) {
    this.#setPath(path);
    const entry = byId('keys').children[Math.min(i, this.#path.keys.length - 1)];
    const wanted = entry?.querySelector(`[data-act="${name}"]`);
    ((wanted?.disabled ? entry.querySelector('.picture') : wanted) ?? byId('key-add')).focus();
  }

  #replace(i) {
    if (!this.#viewer.isSettled) return;
    const current = this.#currentView;
    this.#changeAndFocus(replace(this.#path, i, current), i, 'replace');
    if (!current.picture) this.#addThumbnail(current.view);
  }

  #entry({ view, picture, ease }, i) {
    const { isLoop, keys } = this.#path;
    const number = i + 1;
    const act = (id, sign, press, disabled = false) => make('button', {
      'data-act': id, 'aria-label': t(`key.${id}`, { number }), title: t(`key.${id}`, { number }), text: sign, press, disabled: disabled ? '' : false,
    });
    const go = make('button', {
      class: 'picture', 'aria-label': t('path.go', { number }), title: t('path.go', { number }),
      press: ({ timeStamp }) => {
        this.#stop();
        this.#viewer.show(view, timeStamp);
      },
    }, ...(picture ? [make('img', { src: picture, alt: '' })] : []), make('span', { text: number }));
    go.disabled = !this.#viewer.canControl;
    const acts = make('span', { class: 'acts' },
      act('replace', '⟳', () => this.#replace(i)),
      act('up', '↑', () => this.#changeAndFocus(move(this.#path, i, -1), i - 1, 'up'), i === 0),
      act('down', '↓', () => this.#changeAndFocus(move(this.#path, i, 1), i + 1, 'down'), i === keys.length - 1),
      act('remove', '×', () => this.#changeAndFocus(remove(this.#path, i), i, 'remove')));
    const item = make('li', { 'data-pointer': `/path/keyframes/${i}` }, go, acts);
    if (i > 0 || isLoop) item.append(this.#timing(i, ease));
    else item.append(make('span', { class: 'way', text: t('path.beginning') }));
    return item;
  }

  /** The controls for the way to key i: seconds and easing. */
  #timing(i, ease) {
    const names = i === 0 ? [t('path.seconds.back'), t('path.motion.back')]
      : [t('path.seconds.to', { number: i + 1 }), t('path.motion.to', { number: i + 1 })];
    const field = make('input', {
      type: 'number', min: SECONDS.least, max: SECONDS.most, step: 'any', required: '',
      'aria-label': names[0], title: names[0],
    });
    const choice = make('select', { 'aria-label': names[1], title: names[1] },
      ...EASES.map((value) => new Option(t(`path.ease.${value}`), value, false, value === ease)));
    field.addEventListener('change', () => {
      if (field.reportValidity()) this.#setPath(replace(this.#path, i, { seconds: field.valueAsNumber }));
    });
    choice.addEventListener('change', () => this.#setPath(replace(this.#path, i, { ease: choice.value })));
    return make('span', { class: 'way' }, field, make('span', { text: 's' }), choice);
  }

  get #fps() {
    const field = byId('path-fps');
    return field.validity.valid ? field.valueAsNumber : Number(field.defaultValue);
  }

  /** [width, height] of the output; missing values follow the window or its aspect ratio. */
  get #size() {
    const [wide, high] = this.#screen.size;
    const [width, height] = ['path-width', 'path-height'].map((id) => byId(id).valueAsNumber);
    const like = (side, whole) => Math.max(1, Math.round(side * whole));
    return [width || like(height, wide / high) || wide, height || like(width, high / wide) || high];
  }

  /** Updates everything that depends on the keys and the form. */
  #update() {
    const path = this.#path;
    const { keys, isLoop } = path;
    const { isReady, isSettled } = this.#viewer;
    const isPath = isWhole(path);
    const frames = isPath ? framesOf(path, this.#fps) : 0;
    byId('key-add').disabled = !isSettled || keys.length >= KEYS_MAX;
    byId('turn-add').disabled = !isSettled || keys.length > KEYS_MAX - 5;
    byId('keys-clear').hidden = keys.length === 0;
    byId('path-way').hidden = !isPath;
    byId('path-loop').checked = isLoop;
    const count = keys.length === 1 ? t('path.about.one') : t('path.about.count', { count: keys.length });
    setText(byId('keys-about'), !keys.length ? t('path.about.none')
      : isPath ? t('path.about.whole', { count: keys.length, length: seconds(lengthOf(path)), frames }) : count);
    const length = byId('path-length');
    if (document.activeElement !== length) length.value = isPath ? Number(lengthOf(path).toFixed(2)) : '';
    byId('keys').querySelectorAll('.way input').forEach((field, n) => {
      const key = keys[isLoop ? n : n + 1];
      if (document.activeElement !== field) field.value = Number(key.seconds.toFixed(2));
    });
    const at = byId('path-at');
    at.max = Math.max(1, frames - 1);
    at.disabled = byId('path-play').disabled = !isPath || !isReady;
    this.#showPlace();
    [byId('path-width').placeholder, byId('path-height').placeholder] = this.#size;
    const quality = byId('path-quality');
    quality.disabled = LOSSLESS.includes(byId('path-format').value);
    quality.closest('.row').toggleAttribute('data-idle', quality.disabled);
    showValue(quality, quality.disabled ? t('path.lossless') : quality.value);
    byId('path-draw').disabled = !isPath || this.#isSending || !this.#api();
    setText(byId('path-draw'), isPath ? t('path.render.frames', { frames }) : t('path.render'));
  }

  // Playback: moves the view along the frames, for all participants of this session.

  #showPlace() {
    const at = byId('path-at');
    showValue(at, isWhole(this.#path) ? seconds(secondsAt(this.#path, this.#fps, at.valueAsNumber)) : '');
  }

  #seek(frame, time) {
    this.#viewer.show(viewAt(this.#path, this.#fps, frame), time);
    byId('path-at').value = frame;
    this.#showPlace();
  }

  /** Plays from the slider's position, or from the start if the slider is at the end. */
  #play() {
    if (!this.#viewer.isReady) return;
    const fps = this.#fps;
    const last = framesOf(this.#path, fps) - 1;
    const at = byId('path-at').valueAsNumber;
    const first = at >= last ? 0 : at;
    const player = { start: null, frame: null, view: null }; // the frame that was shown last
    const step = (now) => {
      if (this.#player !== player) return;
      player.start ??= now;
      const frame = Math.min(last, first + Math.floor((now - player.start) / 1000 * fps));
      const isTheirs = player.view && this.#viewer.view !== player.view; // another participant moved the view
      if (!isTheirs && frame !== player.frame) {
        this.#seek(frame, now);
        Object.assign(player, { frame, view: this.#viewer.view });
      }
      if (isTheirs || frame === last) this.#stop();
      else requestAnimationFrame(step);
    };
    this.#player = player;
    this.#showPlaying();
    requestAnimationFrame(step);
  }

  #stop() {
    this.#player = null;
    this.#showPlaying();
  }

  #showPlaying() {
    setText(byId('path-play'), t(this.#player ? 'path.stop' : 'path.play'));
  }

  // Sending.

  get #output() {
    const format = byId('path-format').value;
    return {
      size: this.#size, fps: byId('path-fps').valueAsNumber, format,
      ...(LOSSLESS.includes(format) ? {} : { quality: byId('path-quality').valueAsNumber }),
    };
  }

  async #render() {
    const path = this.#path;
    const api = this.#api();
    if (!isWhole(path) || !api || this.#isSending) return;
    this.#stop();
    this.#isSending = true;
    this.#update();
    try {
      this.#tellMade(await api.createPath(requestOf(path, this.#output)));
    } catch (error) {
      this.#complain(`/path${pointerInto(path, error.pointer ?? '')}`, error.message);
    }
    this.#isSending = false;
    this.#update();
  }
}
