// SPDX-License-Identifier: Apache-2.0
// The dialog "Open a volume": a browser of the daemon's data folder, recently opened volumes, the address of a remote
// volume, and files of this computer.
import { arranged, below, crumbs, filteredSeries, joined, mayBeStudy, numberedSeries, parentOf, searched, sizeText, withRecent } from '../../core/files.js';
import { READINGS, cleanUnit, parseReadings, rememberReading, withReading } from '../../core/readings.js';
import { whenReady } from '../../core/ready.js';
import { t } from '../../core/text.js';
import { byId, icon, make, setText } from '../controls/dom.js';

const RECENT_MAX = 6;
const SEARCH_DELAY_MS = 200;

/** Recently opened volumes of this browser; where storage is forbidden, of this page. */
class Recent {
  #place;
  #list = [];

  constructor(base) {
    this.#place = `splatd:${new URL(base).pathname}recent`;
    try {
      const read = JSON.parse(localStorage.getItem(this.#place) ?? '[]');
      this.#list = Array.isArray(read) ? read.filter(({ source, name }) => typeof source === 'string' && typeof name === 'string') : [];
    } catch { /* unreadable, or forbidden */ }
  }

  get list() { return this.#list; }

  add(entry) {
    this.#list = withRecent(this.#list, entry, RECENT_MAX);
    try {
      localStorage.setItem(this.#place, JSON.stringify(this.#list));
    } catch { /* see above */ }
  }
}

/** How files are read: the choice of the dialog, and what was chosen for a file before. */
class Readings {
  #storage;
  #known;
  #as = byId('open-as');
  #unit = byId('open-unit');

  constructor(storage) {
    this.#storage = storage;
    this.#known = parseReadings(storage.recallForever('readings'));
    this.#as.replaceChildren(...['', 'file', ...READINGS].map((value) => make('option', { value, text: t(`open.as.${value || 'last'}`) })));
  }

  /** The next dialog begins without a choice. */
  reset() {
    this.#as.value = this.#unit.value = '';
  }

  /** The text about how a file was read the last time, for its row. */
  about(source) {
    const { as, unit } = this.#known.get(source) ?? {};
    return [as && t(`open.as.${as}`), unit].filter(Boolean).join(' · ');
  }

  /** What is typed as a unit, and is none; '' = nothing. */
  get badUnit() {
    const typed = this.#unit.value.trim();
    return cleanUnit(typed) ? '' : typed;
  }

  /** Adds the choice of the dialog to the source, or else the choice of the last time. */
  apply(source) {
    const known = this.#known.get(source) ?? { as: '', unit: '' };
    const as = this.#as.value === 'file' ? '' : this.#as.value || known.as;
    const unit = cleanUnit(this.#unit.value) || (this.#as.value === 'file' ? '' : known.unit);
    return { source, as, unit };
  }

  remember({ source, as, unit }) {
    this.#storage.rememberForever('readings', rememberReading(this.#known, source, { as, unit }));
  }
}

/** What the beginning of a file tells, or else its format, and what it consists of; of a slice among others, that it opens all of them. */
function about({ dims, type, format, contents, bytes }, isSlice) {
  const consists = isSlice ? t('open.series.slice') : contents && t(`kinds.${contents}`);
  return [...(dims ? [dims.join(' × ')] : [format, consists]), type, bytes === undefined ? '' : sizeText(bytes)].filter(Boolean).join(' · ');
}

/** Number and description of a DICOM series. */
function plainName({ number, description }) {
  const name = number === undefined ? '' : t('open.series.number', { number });
  return [name, description].filter(Boolean).join(' · ') || t('open.series.unnamed');
}

/** The same; the end of the UID tells series of one name apart. */
function nameOf(series, all) {
  const name = plainName(series);
  const isShared = all.some((other) => other !== series && plainName(other) === name);
  return isShared && series.uid ? `${name} …${series.uid.slice(-12)}` : name;
}

function aboutSeries({ modality, images, size, bytes }) {
  const count = images === 1 ? t('open.series.image') : t('open.series.images', { count: images });
  return [modality, count, size.join(' × '), sizeText(bytes)].filter(Boolean).join(' · ');
}

const isDicom = ({ format }) => format === 'DICOM';

/** The text of a search of sub-folders besides its results. */
function aboutSearch({ isRunning = false, complaint = '', entries = [], unread = 0, cut }) {
  if (complaint) return t('open.find.failed', { reason: complaint });
  if (isRunning) return t('open.find.running');
  if (cut === 'limit' && entries.length === 0) return t('open.find.cut.here');
  const skipped = unread === 1 ? t('open.find.unread.one') : t('open.find.unread', { count: unread });
  return [cut && t(`open.find.cut.${cut}`, { count: entries.length }), unread > 0 && skipped].filter(Boolean).join(' ');
}

/** Searches sub-folders, one search at a time. Of the searches requested meanwhile, only the last one runs. */
class Search {
  #api; #show;
  #wanted = null; // {folder, text}
  #timer = 0;
  #isBusy = false;

  /** show(found): what is known of the search that was asked for: {isRunning}, {complaint} or {entries, unread, cut}. */
  constructor(api, show) {
    this.#api = api;
    this.#show = show;
  }

  /** Searches soon, when no other key follows. text '' = nothing. */
  ask(folder, text) {
    if (this.#wanted ? this.#wanted.folder === folder && this.#wanted.text === text : !text) return;
    this.cancel();
    if (text) {
      this.#wanted = { folder, text };
      this.#timer = setTimeout(() => this.#run(), SEARCH_DELAY_MS);
    }
    this.#show({ isRunning: Boolean(text) });
  }

  cancel() {
    clearTimeout(this.#timer);
    this.#wanted = null;
  }

  async #run() {
    if (this.#isBusy) return; // it goes on below
    this.#isBusy = true;
    for (let asked = null; this.#wanted && this.#wanted !== asked;) {
      asked = this.#wanted;
      const found = await this.#find(asked);
      if (this.#wanted === asked) this.#show(found);
    }
    this.#isBusy = false;
  }

  async #find({ folder, text }) {
    try {
      const { entries, unread, cut } = await this.#api.findFiles(folder, text);
      return { entries: below(folder, entries), unread, cut };
    } catch (error) {
      return { complaint: error.message };
    }
  }
}

class OpenDialog {
  #app; #dialog; #list; #filter; #said; #recent; #readings; #search;
  #folder = '';
  #use; // what opened volumes are for, see app.openVolume()
  #entries = [];
  #series = []; // DICOM series of the folder
  #found = {}; // what the filter finds in sub-folders, see Search
  #asked = 0;
  #opening = null; // what to say of the volume that is opened, [text, isError], also when the folder has been read

  constructor(app) {
    this.#app = app;
    this.#dialog = byId('open');
    this.#list = byId('open-list');
    this.#filter = byId('open-filter');
    this.#said = byId('open-said');
    this.#recent = new Recent(app.base);
    this.#readings = new Readings(app.storage);
    this.#search = new Search(app.api, (found) => {
      this.#found = found;
      this.#refresh();
    });
    this.#filter.addEventListener('input', () => {
      this.#opening = null;
      this.#showEntries();
      this.#searchBelow();
    });
    this.#dialog.addEventListener('keydown', (event) => this.#key(event));
    byId('open-choose').addEventListener('click', () => byId('open-file').click());
    byId('open-file').addEventListener('change', ({ target }) => {
      app.uploads.take([...target.files], this.#use);
      target.value = ''; // the same file may be chosen again
      this.#dialog.close();
    });
    byId('open-close').addEventListener('click', () => this.#dialog.close());
    byId('open-remote').addEventListener('submit', (event) => {
      event.preventDefault();
      const source = byId('open-address').value.trim();
      this.open({ source, name: crumbs(source).at(-1).name });
    });
  }

  show(use) {
    const { may } = this.#app.api;
    this.#use = use;
    byId('open-browser').hidden = !may.browse;
    byId('open-nothing').hidden = Boolean(may.browse);
    byId('open-upload').hidden = !may.upload;
    byId('open-remote').hidden = !may.remote;
    this.#readings.reset();
    this.#showRecent();
    this.#showQuota();
    this.#dialog.showModal();
    if (may.browse) this.#enter(this.#folder);
    else byId('open-choose').focus();
  }

  #showRecent() {
    const { list } = this.#recent;
    byId('open-recent').hidden = list.length === 0;
    byId('open-recent-list').replaceChildren(...list.map((entry) => make('button', {
      class: 'chip', text: entry.name, title: entry.source, press: () => this.open(entry),
    })));
  }

  async #showQuota() {
    if (!this.#app.api.may.upload) return;
    try {
      const { bytes_free: free, bytes_max: most } = await this.#app.api.uploads();
      setText(byId('open-quota'), t('open.quota', { free: sizeText(free), most: sizeText(most) }));
    } catch { /* an upload will say what is wrong */ }
  }

  #say(text, isError = false) {
    this.#said.className = isError ? 'complaint' : 'about';
    setText(this.#said, text);
    this.#said.hidden = !text;
  }

  /** count: entries of the folder whose names are not UTF-8. */
  #tellUnlisted(count) {
    const hint = byId('open-unlisted');
    hint.hidden = count === 0;
    setText(hint, count === 1 ? t('open.unlisted.one') : t('open.unlisted', { count }));
  }

  /** Shows a folder; `focus`: the name of the entry to focus. */
  async #enter(folder, focus = null) {
    const asked = ++this.#asked;
    this.#folder = folder;
    this.#filter.value = '';
    this.#series = [];
    this.#search.cancel();
    this.#found = {};
    this.#opening = null;
    this.#showCrumbs();
    this.#say(t('open.reading'));
    try {
      const entries = [];
      let after = '';
      do {
        const page = await this.#app.api.files(folder, after);
        if (asked !== this.#asked) return;
        entries.push(...page.entries);
        this.#tellUnlisted(page.unlisted);
        after = page.next ?? '';
        this.#entries = entries;
        this.#showEntries();
      } while (after);
      this.#searchBelow();
      this.#focus(focus);
      if (mayBeStudy(folder, entries)) await this.#readSeries(folder, asked);
    } catch (error) {
      if (asked !== this.#asked) return;
      this.#entries = [];
      this.#showEntries();
      this.#tellUnlisted(0);
      this.#say(error.message, true);
    }
  }

  async #readSeries(folder, asked) {
    this.#say(t('open.series.reading'));
    let complaint = '';
    try {
      const { series } = await this.#app.api.series(folder);
      if (asked !== this.#asked) return;
      this.#series = series;
    } catch (error) {
      if (asked !== this.#asked) return;
      complaint = t('open.series.failed', { reason: error.message });
    }
    this.#refresh();
    if (complaint) this.#say(complaint, true);
  }

  /** Shows the entries again; the focus stays. */
  #refresh() {
    const { activeElement: focused } = document;
    const isRow = this.#list.contains(focused);
    this.#showEntries();
    if (isRow) this.#focus(focused.dataset.name);
  }

  /** Looks in sub-folders for what the filter says. */
  #searchBelow() {
    const hasFolders = this.#entries.some(({ kind }) => kind === 'folder');
    this.#search.ask(this.#folder, hasFolders ? searched(this.#filter.value) : '');
  }

  #showCrumbs() {
    const steps = [{ name: t('open.root'), path: '' }, ...crumbs(this.#folder)];
    byId('open-crumbs').replaceChildren(...steps.map(({ name, path }, i) => make('li', {}, make('button', {
      text: name, 'aria-current': i === steps.length - 1 ? 'location' : false, press: () => this.#enter(path),
    }))));
  }

  #showEntries() {
    const shown = arranged(this.#entries, this.#filter.value);
    const isSeries = this.#entries.filter(isDicom).length > 1;
    const rows = shown.map((entry) => {
      const isFolder = entry.kind === 'folder';
      const source = joined(this.#folder, entry.name);
      const told = [about(entry, isSeries && isDicom(entry)), this.#readings.about(source)].filter(Boolean).join(' · ');
      return this.#row(entry.name, told, { 'data-name': entry.name, 'data-kind': entry.kind }, isFolder ? icon('folder') : icon('box'),
        () => (isFolder ? this.#enter(source) : this.#read(source, entry.name)));
    });
    const firstFile = shown.findIndex(({ kind }) => kind !== 'folder');
    const series = arranged(numberedSeries(this.#entries), this.#filter.value);
    if (firstFile >= 0) rows.splice(firstFile, 0, ...series.map((entry) => this.#stepsRow(entry)));
    const listed = filteredSeries(this.#series, this.#filter.value);
    rows.unshift(...listed.map((one) => this.#seriesRow(one)));
    rows.push(...(this.#found.entries ?? []).map((entry) => this.#foundRow(entry)));
    this.#list.replaceChildren(...rows);
    const [first] = this.#buttons;
    if (first) first.tabIndex = 0;
    const { value } = this.#filter;
    const told = this.#found.isRunning && rows.length > 0 ? '' : aboutSearch(this.#found);
    if (this.#opening) this.#say(...this.#opening);
    else if (told || rows.length > 0) this.#say(told, Boolean(this.#found.complaint));
    else this.#say(this.#entries.length > 0 ? t('open.nomatch', { filter: value }) : t('open.empty'));
  }

  /** place: the folder of a find in a sub-folder. */
  #row(name, told, data, picture, press, place = '') {
    return make('li', {}, make('button', { ...data, tabindex: '-1', press }, picture, make('span', { class: 'name', text: name, title: name }),
      make('span', { class: 'about', text: told }), ...(place ? [make('span', { class: 'place', text: place, title: place })] : [])));
  }

  #foundRow(entry) {
    const { name, place, files = 1, bytes } = entry;
    const isFolder = entry.kind === 'folder';
    const source = joined(entry.folder, name);
    const together = t(isDicom(entry) ? 'open.find.dicom' : 'open.steps', { count: files });
    const told = [files > 1 ? `${together} · ${sizeText(bytes)}` : about(entry, false), this.#readings.about(source)].filter(Boolean).join(' · ');
    return this.#row(name, told, { 'data-name': joined(place, name), 'data-kind': entry.kind }, isFolder ? icon('folder') : icon('box'),
      () => (isFolder ? this.#enter(source) : this.#read(source, name)), place);
  }

  #seriesRow(series) {
    const name = nameOf(series, this.#series);
    return this.#row(name, aboutSeries(series), { 'data-name': name, 'data-kind': 'series' }, icon('box'), () => this.open({ source: series.source, name, named: true }));
  }

  /** Numbered files as one time series. */
  #stepsRow({ name, count }) {
    return this.#row(name, t('open.steps', { count }), { 'data-name': name, 'data-kind': 'steps' }, icon('box'), () => this.#read(joined(this.#folder, name), name));
  }

  get #buttons() { return [...this.#list.querySelectorAll('button')]; }

  #focus(name) {
    const buttons = this.#buttons;
    (buttons.find((button) => button.dataset.name === name) ?? this.#filter).focus();
  }

  #key(event) {
    const buttons = this.#buttons;
    const at = buttons.indexOf(document.activeElement);
    const isFilter = document.activeElement === this.#filter;
    const steps = { ArrowDown: at + 1, ArrowUp: at - 1, Home: 0, End: buttons.length - 1, PageDown: at + 10, PageUp: at - 10 };
    if (event.ctrlKey || event.altKey || event.metaKey || (at < 0 && !isFilter)) return;
    if (event.key in steps && (at >= 0 || event.key === 'ArrowDown')) {
      event.preventDefault();
      if (at === 0 && event.key === 'ArrowUp') {
        this.#filter.focus();
        return;
      }
      const to = buttons[Math.min(Math.max(steps[event.key], 0), buttons.length - 1)];
      for (const button of buttons) button.tabIndex = button === to ? 0 : -1;
      to?.focus();
    } else if (event.key === 'Enter' && isFilter) {
      event.preventDefault();
      if (buttons.length === 1) buttons[0].click();
      else buttons[0]?.focus();
    } else if (event.key === 'Backspace' && this.#folder && (at >= 0 || !this.#filter.value)) {
      event.preventDefault();
      this.#enter(parentOf(this.#folder), crumbs(this.#folder).at(-1).name);
    }
  }

  /** Opens a file of the folder as the dialog says, and remembers it for this file once it is ready. */
  #read(source, name) {
    const { badUnit: unit } = this.#readings;
    if (unit) {
      this.#say(t('open.unit.bad', { unit }), true);
      byId('open-unit').focus();
      return;
    }
    const reading = this.#readings.apply(source);
    this.open({ source: withReading(source, reading), name }, () => this.#readings.remember(reading));
  }

  /** Loads a source, and shows it once it is ready. named: its name, instead of the name of the file. opened() is called when it is ready. */
  async open({ source, name, named = false }, opened = () => {}) {
    const { api, connection, notice, openVolume } = this.#app;
    const tell = (...opening) => {
      this.#opening = opening;
      this.#say(...opening);
    };
    try {
      tell(t('open.opening', { name }));
      const volume = await api.openVolume(named ? { source, name } : { source });
      this.#dialog.close();
      openVolume(volume, this.#use);
      whenReady(connection, volume.id).then(() => {
        this.#recent.add({ source, name, named });
        opened();
      }, () => {}); // openVolume() says why
    } catch (error) {
      tell(error.message, true);
      if (!this.#dialog.open) notice.show(error.message, 'error', 'open');
    }
  }
}

/** Returns app.openVolume(volume, use), which calls use(volume) as soon as the volume is ready; by default the picture shows it. */
function useWhenReady(app) {
  const { connection, viewer, notice } = app;
  const show = ({ id }) => {
    app.channels.showColors(id);
    viewer.selectVolume(id);
  };
  let wanted = null; // {id, use}

  function look(volumes) {
    const volume = wanted && volumes.find(({ id }) => id === wanted.id);
    if (!volume || volume.state === 'loading') return;
    const { use } = wanted;
    wanted = null;
    if (volume.state === 'ready') {
      notice.hide('open');
      use(volume);
    } else {
      notice.show(t('open.failed', { name: volume.name || volume.id, reason: volume.reason ?? '' }), 'error', 'open');
    }
  }

  connection.on('volumes', look);
  return ({ id }, use = show) => {
    wanted = { id, use };
    connection.refresh().catch(() => {}); // the stream reports a lost daemon
  };
}

export function install(app) {
  app.openVolume = useWhenReady(app);
  const dialog = new OpenDialog(app);
  /** Shows the dialog. use: see app.openVolume(). */
  app.open = (use) => { if (app.mayOpen) dialog.show(use); };
}
