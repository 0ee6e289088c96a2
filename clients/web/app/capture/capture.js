// SPDX-License-Identifier: Apache-2.0
// Saves and copies the picture in any size and format, and copies the view as a link, as JSON and as commands.
import { SIZES, captureView, fitSize, hasAlpha, readProgress, sizeProblem } from '../../core/capture.js';
import { curlCommand, fileName, renderQuery, splatctlCommand } from '../../core/commands.js';
import { t } from '../../core/text.js';
import { burnIn, hasAnnotations } from '../annotations/annotations.js';
import { composePanes, composedSize } from './composed.js';
import { make } from '../controls/dom.js';
import { showValue } from '../controls/fields.js';
import { joinLink, saidOfLink } from '../session/people.js';
import { shortBytes } from '../status/status.js';

const FORMATS = ['png', 'jpeg', 'webp', 'exr'];
const CHOICES = ['capture-size', 'capture-width', 'capture-height', 'capture-format', 'capture-quality', 'capture-alpha', 'capture-burn'];

/** Starts the browser's download of a Blob. */
export function download(blob, name) {
  const url = URL.createObjectURL(blob);
  make('a', { href: url, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(url), 60000);
}

const row = (id, label, control, { title = false, ...more } = {}, ...after) => make('div', { class: 'row', title, ...more },
  make('label', { for: id, text: label }), control, ...after);
const option = (value, text) => make('option', { value, text });
const toggle = (id, isOn = false) => make('input', { id, type: 'checkbox', role: 'switch', checked: isOn });

export function install(app) {
  app.capture = new Capture(app, app.panel.section({ id: 'capture' }));
  app.toolbar.button({ id: 'tool-capture', press: () => app.capture.save() });
}

class Capture {
  #app; #what; #size; #width; #height; #format; #quality; #alpha; #burn; #withToken;
  #progress; #state; #busy; #text; #textNote;
  #running = null; // AbortController of the picture that is being made

  constructor(app, body) {
    this.#app = app;
    this.#build(body);
    this.#restore();
    for (const control of [this.#size, this.#format, this.#width, this.#height, this.#quality, this.#alpha, this.#burn]) {
      control.addEventListener('input', () => this.#changed());
    }
    this.#what.addEventListener('input', () => this.#show());
    app.layout.on('change', () => this.#show());
    app.screen.onResize(() => this.#show());
    app.connection.on('session', () => this.#show());
    this.#show();
  }

  #build(body) {
    const number = (id, label) => make('input', { id, type: 'number', min: 1, max: 8192, step: 1, 'aria-label': label });
    this.#what = make('select', { id: 'capture-what' }, ...['panes', 'picture'].map((name) => option(name, t(`capture.what.${name}`))));
    this.#size = make('select', { id: 'capture-size' }, ...Object.keys(SIZES).map((name) => option(name, t(`capture.size.${name}`))),
      option('custom', t('capture.size.custom')));
    this.#width = number('capture-width', t('capture.width'));
    this.#height = number('capture-height', t('capture.height'));
    this.#format = make('select', { id: 'capture-format' }, ...FORMATS.map((name) => option(name, t(`capture.format.${name}`))));
    this.#quality = make('input', { id: 'capture-quality', type: 'range', min: 1, max: 100, step: 1, value: 90 });
    this.#alpha = toggle('capture-alpha');
    this.#burn = toggle('capture-burn');
    this.#withToken = toggle('capture-token');
    this.#state = make('p', { class: 'about', id: 'capture-state', role: 'status' });
    this.#progress = make('progress', { max: 1, 'aria-label': t('capture.progress') });
    this.#busy = make('div', { id: 'capture-busy', hidden: true }, this.#progress,
      make('button', { id: 'capture-cancel', text: t('capture.cancel'), press: () => this.#running?.abort() }));
    this.#text = make('textarea', { id: 'capture-text', readonly: true, rows: 4, spellcheck: 'false', 'aria-label': t('capture.copied.text') });
    this.#textNote = make('p', { class: 'about', id: 'capture-note', role: 'status' });
    const copy = (id, of) => make('button', { id: `copy-${id}`, text: t(`capture.copy.${id}`), title: t(`capture.copy.${id}.title`), press: () => this.#copy(id, of) });
    body.append(
      row('capture-what', t('capture.what'), this.#what, { title: t('capture.what.title') }),
      row('capture-size', t('capture.size'), this.#size),
      make('div', { class: 'row', id: 'capture-custom', role: 'group', 'aria-label': t('capture.size.custom') },
        make('span', { text: t('capture.pixels') }), make('span', { class: 'number' }, this.#width, '×', this.#height)),
      row('capture-format', t('capture.format'), this.#format),
      row('capture-quality', t('capture.quality'), this.#quality, { id: 'capture-quality-row' }, make('output', { for: 'capture-quality' })),
      row('capture-alpha', t('capture.alpha'), this.#alpha, { title: t('capture.alpha.title') }),
      row('capture-burn', t('capture.burn'), this.#burn, { title: t('capture.burn.title') }),
      make('div', { class: 'buttons' },
        make('button', { id: 'capture-save', text: t('capture.save'), press: () => this.save() }),
        make('button', { id: 'capture-copy', text: t('capture.copy'), title: t('capture.copy.title'), press: () => this.copy() })),
      this.#state, this.#busy,
      make('h3', { text: t('capture.share') }),
      make('div', { class: 'buttons' },
        copy('link', () => this.#link()), copy('json', () => JSON.stringify(this.#image.view, null, 2))),
      make('div', { class: 'buttons' },
        copy('curl', () => curlCommand(this.#app.base, this.#image, this.#token)),
        copy('splatctl', () => splatctlCommand(this.#app.base, this.#image, this.#token))),
      row('capture-token', t('capture.token'), this.#withToken, { title: t('capture.token.title') }),
      this.#text, this.#textNote,
    );
    this.#text.hidden = true;
  }

  #restore() {
    let known = {};
    try {
      known = JSON.parse(this.#app.storage.recall('capture') ?? '{}');
    } catch { /* an unreadable entry counts as missing */ }
    for (const id of CHOICES) {
      const control = [this.#size, this.#width, this.#height, this.#format, this.#quality, this.#alpha, this.#burn][CHOICES.indexOf(id)];
      if (known[id] === undefined) continue;
      if (control.type === 'checkbox') control.checked = known[id] === true;
      else control.value = String(known[id]);
    }
    if (!this.#size.value) this.#size.value = 'window';
    if (!this.#format.value) this.#format.value = 'png';
  }

  #changed() {
    const values = [this.#size.value, this.#width.value, this.#height.value, this.#format.value, this.#quality.value, this.#alpha.checked, this.#burn.checked];
    this.#app.storage.remember('capture', JSON.stringify(Object.fromEntries(CHOICES.map((id, i) => [id, values[i]]))));
    this.#show();
  }

  get #maxPixels() { return this.#app.connection.session?.max_pixels ?? Infinity; }
  get #isLossy() { return this.#format.value === 'jpeg' || this.#format.value === 'webp'; }
  get #token() { return this.#withToken.checked ? this.#app.api.token : ''; }

  /** True if the picture of all panes is saved, as the layout shows them; it has the size of the window. */
  get #isComposed() { return this.#app.layout.showsSlices && this.#what.value === 'panes'; }

  /** The chosen [width, height] in px. */
  get size() {
    if (this.#isComposed) return composedSize();
    if (this.#size.value === 'custom') return [this.#width.valueAsNumber, this.#height.valueAsNumber];
    return SIZES[this.#size.value] ?? this.#app.screen.size;
  }

  get #image() {
    const format = this.#isComposed && this.#format.value === 'exr' ? 'png' : this.#format.value;
    return {
      view: captureView(this.#app.viewer.view, this.size, this.#alpha.checked && hasAlpha(format)), format, quality: Number(this.#quality.value),
    };
  }

  #show() {
    this.#what.closest('.row').hidden = !this.#app.layout.showsSlices;
    for (const control of [this.#size, this.#alpha, this.#burn]) control.closest('.row').hidden = this.#isComposed;
    [...this.#format.options].find(({ value }) => value === 'exr').disabled = this.#isComposed;
    const isCustom = this.#size.value === 'custom';
    const limit = this.#maxPixels;
    if (!isCustom || !this.#width.value || !this.#height.value) {
      const [width, height] = isCustom ? fitSize(this.#app.screen.size, limit) : this.size;
      this.#width.value = String(width);
      this.#height.value = String(height);
    }
    this.#width.disabled = this.#height.disabled = !isCustom;
    showValue(this.#quality, this.#quality.value);
    this.#quality.closest('.row').hidden = !this.#isLossy;
    this.#alpha.disabled = !hasAlpha(this.#format.value);
    this.#alpha.closest('.row').toggleAttribute('data-idle', this.#alpha.disabled);
    this.#burn.disabled = this.#format.value === 'exr';
    this.#burn.closest('.row').toggleAttribute('data-idle', this.#burn.disabled);
    for (const choice of this.#size.options) {
      const size = SIZES[choice.value];
      choice.disabled = Boolean(size && sizeProblem(size, limit));
    }
    if (!this.#running) this.#state.textContent = this.#problem ?? '';
  }

  /** Why the size is not possible, or null. */
  get #problem() {
    const problem = sizeProblem(this.size, this.#maxPixels);
    if (!problem) return null;
    return problem.code === 'side' ? t('capture.side', { limit: problem.limit })
      : t('capture.limit', { size: fitSize(this.size, problem.limit).join(' × ') });
  }

  /** Saves the picture as a file. */
  async save() {
    const { format, view } = this.#image;
    const blob = await this.#make(format);
    if (blob) download(blob, fileName(view.volume, format));
  }

  /** Copies the picture as PNG. */
  async copy() {
    if (!navigator.clipboard?.write || !window.ClipboardItem) {
      this.#say(t('capture.noclipboard'), 'warning');
      return;
    }
    const picture = this.#make('png');
    try {
      // The promise goes to the browser at once, because it takes only what a press of a button starts.
      await navigator.clipboard.write([new ClipboardItem({ 'image/png': picture.then((blob) => blob ?? Promise.reject(new Error(t('saved.nopicture')))) })]);
      this.#say(t('capture.copied'), 'success');
    } catch (error) {
      if (await picture.catch(() => null)) this.#say(t('capture.copy.failed', { reason: error.message }), 'error');
    }
  }

  /** Resolves to the Blob, or to null after an error or a cancellation. */
  async #make(format) {
    if (this.#running || !this.#app.viewer.view) return null;
    const problem = this.#problem;
    if (problem) {
      this.#say(problem, 'warning');
      this.#app.panel.reveal('capture');
      return null;
    }
    this.#running = new AbortController();
    this.#busy.hidden = false;
    this.#progress.removeAttribute('value');
    this.#say(t('capture.rendering', { size: this.size.join(' × ') }));
    try {
      const blob = await (this.#isComposed ? this.#compose(format, this.#running.signal) : this.#fetch(format, this.size, this.#running.signal));
      this.#say(t('capture.done', { size: this.size.join(' × '), bytes: shortBytes(blob.size) }), 'success');
      return blob;
    } catch (error) {
      if (error.name === 'AbortError') this.#say(t('capture.cancelled'));
      else this.#say(this.#explain(error), 'error');
      return null;
    } finally {
      this.#running = null;
      this.#busy.hidden = true;
    }
  }

  #explain(error) {
    if (error.status === 429 || error.status === 503) return t('capture.busy', { reason: error.message });
    return t('capture.failed', { reason: error.message });
  }

  #say(text, tone = 'info') {
    this.#state.textContent = text;
    if (!this.#state.closest('details').open || this.#app.panel.isClosed) this.#app.notice.show(text, tone);
  }

  /** All panes; the 3-D picture among them in full quality. */
  async #compose(format, signal) {
    const { layout, screen } = this.#app;
    const picture = layout.isShown('3d') ? await this.#fetch('png', screen.size, signal) : null;
    return composePanes(picture, { type: `image/${format}`, quality: this.#image.quality });
  }

  async #fetch(format, size, signal) {
    const { connection, api } = this.#app;
    const { view, quality } = { ...this.#image, view: captureView(this.#app.viewer.view, size, !this.#isComposed && this.#alpha.checked && hasAlpha(format)) };
    const answer = connection.session?.isJoined
      ? await api.snapshot(connection.session, new URLSearchParams({
        format, size: view.size.join(','), background: JSON.stringify(view.background), ...(this.#isLossy ? { quality } : {}),
      }), signal)
      : await api.render(view, renderQuery({ format, quality }), signal);
    const chunks = await readProgress(answer, (received, total) => {
      if (total) this.#progress.value = received / total;
    });
    const blob = new Blob(chunks, { type: answer.headers.get('Content-Type') });
    if (this.#isComposed || !this.#burn.checked || format === 'exr' || !hasAnnotations()) return blob;
    return burnIn(blob, { size: view.size, viewport: this.#app.screen.viewport, quality });
  }

  async #link() {
    const { connection, api, viewer, base } = this.#app;
    if (connection.session?.isJoined) return joinLink(this.#app);
    return `${base}#${new URLSearchParams({ view: (await api.saveView(viewer.view)).id })}`;
  }

  async #copy(id, of) {
    try {
      const text = await of();
      this.#text.hidden = false;
      this.#text.value = text;
      this.#text.scrollTop = 0;
      // Without a secure context there is no clipboard; the user copies from the field.
      const isCopied = await navigator.clipboard?.writeText(text).then(() => true, () => false);
      if (!isCopied) this.#text.select();
      this.#textNote.textContent = id === 'link' ? saidOfLink(this.#app, isCopied) : t(isCopied ? 'people.copied' : 'people.copy');
    } catch (error) {
      this.#textNote.textContent = error.message;
    }
  }
}
