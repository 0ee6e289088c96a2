// SPDX-License-Identifier: Apache-2.0
// Files of this computer: dropped on the page or chosen, sent with progress, then loaded. An upload that a reload or a crash
// interrupted continues when the same file is chosen again.
import { sortedIntoSets } from '../../core/file_sets.js';
import { sizeText } from '../../core/files.js';
import { t } from '../../core/text.js';
import { Upload, refusalText } from '../../core/upload.js';
import { byId, icon, make, setText } from '../controls/dom.js';

const MANY = 3; // from so many companions on, the files of a volume share one row
const SENDING_MAX = 3; // files at once: a browser opens six connections to a daemon, and the page needs some for itself

/** The digest of a part for Upload-Checksum; '' where the browser has none (http from another machine). */
async function checksum(part) {
  if (!crypto.subtle) return '';
  const digest = new Uint8Array(await crypto.subtle.digest('SHA-256', await part.arrayBuffer()));
  return `sha256 ${btoa(String.fromCharCode(...digest))}`;
}

const ENV = {
  now: () => performance.now(), checksum,
  setTimeout: (...args) => window.setTimeout(...args), clearTimeout: (id) => window.clearTimeout(id),
};

function timeText(seconds) {
  if (seconds < 60) return t('upload.left.seconds', { seconds: Math.max(1, Math.round(seconds)) });
  return t('upload.left.minutes', { minutes: Math.round(seconds / 60) });
}

function stateText(upload, isOfSet, set) {
  const percent = Math.floor(100 * upload.sent / upload.bytes);
  const size = sizeText(upload.bytes);
  switch (upload.state) {
    case 'idle': return t('upload.queued', { size });
    case 'paused': return t('upload.paused', { percent, size });
    case 'waiting': return t('upload.waiting', { percent });
    case 'failed': return refusalText(upload);
    case 'sent':
      if (set) return t('upload.set', set);
      return isOfSet ? t('upload.sending', { percent, size }) : t('upload.opening');
    default: return [t('upload.sending', { percent, size }), upload.rate > 0 ? t('upload.rate', { rate: sizeText(upload.rate) }) : '',
      upload.secondsLeft === null ? '' : timeText(upload.secondsLeft)].filter(Boolean).join(' · ');
  }
}

/** A row below the list of volumes. */
class Row {
  #text; #progress; #toggle;

  /** isOfSet: other files must arrive before the volume is opened. */
  constructor(upload, isOfSet, remove) {
    this.upload = upload;
    this.isOfSet = isOfSet;
    this.set = null; // of the first file of a volume in many files: {done, total}, files
    this.isHidden = false; // one of many files, which the first one counts
    this.drop = null;
    this.#text = make('span', { class: 'about' });
    this.#progress = make('progress', { max: 1, 'aria-label': t('upload.progress', { name: upload.name }) });
    this.#toggle = make('button', { class: 'close', press: () => (upload.isActive ? upload.pause() : upload.resume()) });
    const cancel = make('button', { class: 'close', 'aria-label': t('upload.cancel', { name: upload.name }), title: t('upload.cancel', { name: upload.name }), press: remove });
    cancel.append(icon('x'));
    this.element = make('li', { 'data-upload': upload.name }, make('div', { class: 'pick' }, make('span', { class: 'name', text: upload.name, title: upload.name }), this.#text, this.#progress),
      this.#toggle, cancel);
    this.show();
  }

  show() {
    const { upload } = this;
    this.element.dataset.state = upload.state;
    setText(this.#text, stateText(upload, this.isOfSet, this.set));
    this.element.hidden = this.isHidden && upload.state !== 'failed';
    this.#progress.value = this.set ? this.set.done / this.set.total : upload.sent / upload.bytes;
    this.#toggle.hidden = upload.state === 'sent';
    const [name, label] = upload.isActive ? ['pause', t('upload.pause', { name: upload.name })]
      : upload.state === 'failed' ? ['again', t('upload.again', { name: upload.name })] : ['play', t('upload.resume', { name: upload.name })];
    if (this.#toggle.dataset.icon === name) return;
    this.#toggle.dataset.icon = name;
    this.#toggle.replaceChildren(name === 'pause' ? icon('pause') : name === 'play' ? icon('play') : icon('refresh-cw'));
    Object.assign(this.#toggle, { title: label, ariaLabel: label });
  }
}

class Uploads {
  #app; #list;
  #rows = [];
  #wanted = null; // an upload of before whose file the user is about to choose

  constructor(app) {
    this.#app = app;
    this.#list = byId('uploads');
  }

  /** Sends files, or continues an upload that an earlier page began with the same file. use: see app.openVolume(). */
  async take(files, use) {
    const wanted = this.#wanted;
    this.#wanted = null;
    this.#app.notice.hide('open'); // about files that were opened before
    let known = [];
    try {
      known = (await this.#app.api.uploads()).uploads;
    } catch { /* the upload will say what is wrong */ }
    const rest = files.filter((file) => file.size > 0);
    for (const { name } of files.filter((file) => file.size === 0)) this.#app.notice.show(t('upload.empty', { name }), 'warning', 'open');
    for (const set of await sortedIntoSets(rest)) this.#take(set, known, wanted, use);
  }

  #take({ file, companions, missing }, known, wanted, use) {
    if (missing.length > 0) {
      this.#app.notice.show(t('upload.missing', { name: file.name, files: missing.slice(0, 3).join(', ') + (missing.length > 3 ? ' …' : '') }), 'warning', 'open');
      return;
    }
    if (this.#rows.some(({ upload }) => upload.name === file.name && upload.bytes === file.size && upload.state !== 'failed')) return;
    const before = this.#findBefore(known, file, wanted, companions.length > 0);
    if (companions.length === 0) {
      const header = before?.header ?? null; // the samples of a header that arrived before
      this.#begin(file, { id: before?.id, header, done: (row) => this.#load([row], header ?? row.upload.id, use) });
      return;
    }
    this.#begin(file, { id: before?.id, isOfSet: true, done: (row) => this.#takeCompanions(row, companions, known, wanted, use) });
  }

  /** Sends the files of a header that arrived, then opens it. */
  #takeCompanions(row, companions, known, wanted, use) {
    const header = row.upload.id;
    const rows = [row];
    const isMany = companions.length >= MANY;
    const count = () => {
      if (!isMany) return;
      row.set = { done: rows.filter(({ upload }) => upload.state === 'sent').length, total: companions.length + 1 };
      row.show();
    };
    const done = () => {
      count();
      if (rows.length > companions.length && rows.every(({ upload }) => upload.state === 'sent')) this.#load(rows, header, use);
    };
    for (const file of companions) {
      const id = this.#findBefore(known.filter((one) => one.header === header), file, wanted, true)?.id;
      rows.push(this.#begin(file, { id, header, isOfSet: companions.length > 1, isHidden: isMany, done, drop: () => this.#dropAll(rows) }));
    }
    count();
    row.drop = () => this.#dropAll(rows);
  }

  /** The upload that this very file began: a file that changed meanwhile is another one. */
  #findBefore(known, file, wanted, isOfSet) {
    const fits = ({ id, name, bytes, modified, offset, expires }) => name === file.name && bytes === file.size && expires !== undefined && (offset < bytes || isOfSet)
      && (modified === file.lastModified || id === wanted && modified === undefined);
    return known.find(fits) ?? null;
  }

  /** Adds a row and sends its file; done(row): it has arrived; drop(): what its button for cancelling does, if not only this. */
  #begin(file, { id = null, header = null, isOfSet = false, isHidden = false, done, drop = null }) {
    const upload = new Upload({ file, api: () => this.#app.api, id, header, env: ENV });
    const row = new Row(upload, isOfSet, () => (row.drop ? row.drop() : this.#remove(row)));
    row.drop = drop;
    row.isHidden = isHidden;
    row.show();
    let isDone = false;
    for (const failed of this.#rows.filter((other) => other.upload.name === file.name && other.upload.state === 'failed')) this.#remove(failed);
    this.#rows.push(row);
    this.#list.querySelector(`[data-before="${CSS.escape(id ?? '')}"]`)?.remove();
    this.#list.append(row.element);
    this.#list.hidden = false;
    upload.on('change', () => {
      row.show();
      if (upload.state === 'sent' && !isDone) {
        isDone = true;
        done(row);
      }
      this.#startNext();
    });
    this.#startNext();
    this.#app.panel.toggle(true);
    if (!isHidden) row.element.scrollIntoView({ block: 'nearest' });
    return row;
  }

  #startNext() {
    if (this.#rows.filter(({ upload }) => upload.isActive).length >= SENDING_MAX) return;
    this.#rows.find(({ upload }) => upload.state === 'idle')?.upload.resume(); // its change starts the next one
  }

  async #load(rows, id, use) {
    try {
      const volume = await this.#app.api.openVolume({ upload: id });
      for (const row of rows) this.#drop(row);
      this.#app.openVolume(volume, use);
    } catch (error) {
      for (const row of rows) this.#drop(row);
      this.#app.notice.show(t('open.failed', { name: rows[0].upload.name, reason: error.message }), 'error', 'open');
    }
  }

  /** Cancels a header with its files; the daemon forgets the files with their header. */
  #dropAll(rows) {
    const header = rows[0].upload;
    if (header.id) this.#app.api.deleteUpload(header.id).catch(() => {}); // it expires otherwise
    for (const row of rows) this.#remove(row);
  }

  #remove(row) {
    row.upload.cancel();
    this.#drop(row);
  }

  #drop(row) {
    const hadFocus = row.element.contains(document.activeElement);
    this.#rows = this.#rows.filter((other) => other !== row);
    row.element.remove();
    this.#list.hidden = this.#list.children.length === 0;
    if (hadFocus) byId('open-button').focus();
  }

  resumeWaiting() {
    for (const { upload } of this.#rows) if (upload.state === 'waiting') upload.resume();
  }

  /** Shows the uploads that an earlier page began and did not finish. */
  async showBefore() {
    let known;
    try {
      ({ uploads: known } = await this.#app.api.uploads());
    } catch {
      return; // an upload will say what is wrong
    }
    for (const before of known) {
      if (before.expires === undefined || before.offset === before.bytes || this.#rows.some(({ upload }) => upload.id === before.id)
          || this.#list.querySelector(`[data-before="${before.id}"]`)) continue;
      this.#list.append(this.#beforeRow(before));
    }
    this.#list.hidden = this.#list.children.length === 0;
  }

  #beforeRow({ id, name, bytes, offset }) {
    const discard = make('button', {
      class: 'close', 'aria-label': t('upload.cancel', { name }), title: t('upload.cancel', { name }),
      press: () => {
        this.#app.api.deleteUpload(id).catch(() => {}); // it expires otherwise
        item.remove();
        this.#list.hidden = this.#list.children.length === 0;
      },
    });
    discard.append(icon('x'));
    const item = make('li', { 'data-before': id, 'data-state': 'before' }, make('div', { class: 'pick' }, make('span', { class: 'name', text: name, title: name }),
      make('span', { class: 'about', text: t('upload.before', { percent: Math.floor(100 * offset / bytes), size: sizeText(bytes) }) }),
      make('button', {
        class: 'link', text: t('upload.before.choose'),
        press: () => {
          this.#wanted = id;
          byId('open-file').click();
        },
      })), discard);
    return item;
  }
}

/** The dropped files, and the files in dropped folders. */
async function filesOf(transfer) {
  const entries = [...transfer.items].map((item) => item.webkitGetAsEntry?.()).filter(Boolean); // before the first await
  const files = [...transfer.files];
  if (!entries.some((entry) => entry.isDirectory)) return files;
  const found = [];
  const read = async (entry) => {
    if (entry.isFile) found.push(await new Promise((resolve, reject) => { entry.file(resolve, reject); }));
    const reader = entry.isDirectory ? entry.createReader() : null;
    for (let some = reader ? [null] : []; some.length > 0;) {
      some = await new Promise((resolve, reject) => { reader.readEntries(resolve, reject); }); // a hundred at most
      for (const one of some) await read(one);
    }
  };
  for (const entry of entries) await read(entry);
  return found.filter(({ name }) => !name.startsWith('.'));
}

/** The whole page takes files; a sheet says so while one is dragged over it. */
function installDrop(app) {
  const zone = byId('drop');
  const may = () => app.api.may.upload && !app.connection.session?.isJoined;
  const isFile = (event) => event.dataTransfer?.types.includes('Files');
  const isOther = (event) => event.target.closest?.('#transfer'); // which takes transfer functions
  let depth = 0;
  const end = () => {
    depth = 0;
    zone.hidden = true;
  };
  window.addEventListener('dragenter', (event) => {
    if (!isFile(event)) return;
    depth += 1;
    setText(byId('drop-text'), may() ? t('drop.text') : t('drop.denied'));
    zone.hidden = Boolean(isOther(event));
  });
  window.addEventListener('dragleave', (event) => {
    if (!isFile(event)) return;
    depth -= 1;
    if (depth <= 0) end();
  });
  window.addEventListener('dragover', (event) => { if (isFile(event)) event.preventDefault(); });
  window.addEventListener('drop', (event) => {
    end();
    if (!isFile(event) || event.defaultPrevented || isOther(event)) return;
    event.preventDefault(); // else the browser leaves the page and shows the file
    if (may()) filesOf(event.dataTransfer).then((files) => app.uploads.take(files));
  });
}

export function install(app) {
  const { connection } = app;
  app.uploads = new Uploads(app);
  installDrop(app);
  let isFirst = true;
  connection.on('volumes', () => {
    if (!isFirst || !app.api.may.upload || connection.session?.isJoined) return;
    isFirst = false;
    app.uploads.showBefore();
  });
  connection.on('state', ({ state }) => { if (state === 'live') app.uploads.resumeWaiting(); });
  window.addEventListener('online', () => app.uploads.resumeWaiting());
}
