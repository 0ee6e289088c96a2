// SPDX-License-Identifier: Apache-2.0
// The measurements of the session in this window: local changes at once, one request per measurement in flight, undo, and what the daemon
// tells of others. Events: change; hover. The parts: measure_tools.js (drawing new ones), measure_layer.js (lines above the pictures),
// measure_section.js (the panel).
import { Emitter } from '../../core/emitter.js';
import { valueUnit } from '../../core/lengths.js';
import { Changes, KINDS, MeasureList, putParams, quickValue, unitOf } from '../../core/measures.js';
import { t } from '../../core/text.js';
import { installLayers } from './measure_layer.js';
import { installSection } from './measure_section.js';
import { installTools } from './measure_tools.js';

const PAUSE_MS = 60; // between two changes of one measurement; the daemon takes 20 per second
const RETRY_MS = 300;
const TRIES = 5;
const OVER_A_LIMIT = -32005;
const ID_BYTES = 8;

/** What the points of a path depend on. */
const pathKey = ({ points, range, value }) => JSON.stringify([points, range, value]);
const newId = () => [...crypto.getRandomValues(new Uint8Array(ID_BYTES))].map((byte) => byte.toString(16).padStart(2, '0')).join('');
const pause = (ms) => new Promise((resolve) => { setTimeout(resolve, ms); });

export function install(app) {
  const measures = new Measures(app);
  app.measures = measures;
  installLayers(app, measures);
  installTools(app, measures);
  installSection(app, measures);
}

export class Measures extends Emitter {
  #app;
  #list = new MeasureList();
  #changes = new Changes();
  #queues = new Map(); // id → {patch, isRemoval}: what is not sent yet; present while a request is in flight
  #session = null;
  #gesture = null; // {id, before}: a drag counts as one change
  #selected = null;
  /** True if a measurement was selected or changed after the newest change of the transfer function, the layers and the edits. */
  isNewest = false;
  #paths = new Map(); // id → {key, points}: of the paths that are drawn
  #numbers = new Map(); // id → number in the name of a measurement without a text
  /** The measurement under the pointer, by id. */
  hovered = null;
  /** The handle of the selected measurement that has the focus; null = none. */
  handle = null;
  /** A world point that the plot of a profile points at. */
  probe = null;

  constructor(app) {
    super();
    this.#app = app;
    const { connection, viewer } = app;
    connection.on('state', ({ state }) => {
      if (state === 'live') this.#joined();
    });
    connection.on('notification', ({ method, params }) => {
      if (method !== 'session.measures') return;
      this.#list.take(params, (id) => this.#queues.has(id));
      this.#show();
    });
    viewer.on('view', () => this.#show());
  }

  /** The measurements of the volume that is shown. */
  get items() {
    return this.#list.of(this.#app.viewer.view?.volume);
  }

  /** How many measurements belong to other volumes. */
  get elsewhere() { return this.#list.all.length - this.items.length; }

  get canEdit() {
    const { connection, participants } = this.#app;
    return connection.isLive && (participants.isHolder || participants.hasControlRole);
  }

  get selected() { return this.items.find(({ id }) => id === this.#selected) ?? null; }
  /** False if none is selected, or this client may not. */
  removeSelected() {
    if (!this.selected || !this.canEdit) return false;
    this.remove(this.selected.id);
    return true;
  }

  get canUndo() { return this.canEdit && this.#changes.canUndo; }
  get canRedo() { return this.canEdit && this.#changes.canRedo; }

  /** The text of a measurement, or its kind and number. */
  nameOf({ id, kind, text }) {
    if (text) return text;
    if (!this.#numbers.has(id)) this.#numbers.set(id, this.#numbers.size + 1);
    return t(`measure.${kind}.number`, { number: this.#numbers.get(id) });
  }

  select(id) {
    this.isNewest = true;
    if (this.#selected === id) return;
    this.#selected = id;
    this.handle = this.probe = null;
    this.#show();
  }

  /** The pointer is on the lines of a measurement; null = of none. */
  hover(id) {
    if (this.hovered === id) return;
    this.hovered = id;
    this.emit('hover');
  }

  pointAt(world) {
    this.probe = world;
    this.emit('change');
  }

  focusHandle(handle) {
    this.handle = handle;
    this.emit('change');
  }

  /** The points of a path; null until the daemon told them. */
  pathOf(item) {
    const known = this.#paths.get(item.id);
    return item.kind === 'path' && known?.key === pathKey(item) ? known.points : null;
  }

  /** Asks for the points of paths that are new, or that changed. */
  async #findPaths() {
    const { session } = this.#app.connection;
    const wanted = this.items.filter((item) => item.kind === 'path' && item.value !== null && item.straight !== undefined && !item.hidden && this.#paths.get(item.id)?.key !== pathKey(item));
    for (const item of wanted) {
      const found = { key: pathKey(item), points: null };
      this.#paths.set(item.id, found);
      try {
        const { kind, points, range } = item;
        found.points = (await this.#app.api.measure(session.id, session.tokens?.view ?? session.token, { kind, points, range })).path ?? null;
        this.emit('change');
      } catch { /* a straight line stands for it */ }
    }
  }

  add(kind, points, range = null) {
    if (!this.canEdit) return null;
    const { participants, viewer } = this.#app;
    const item = {
      id: newId(), kind, points, ...(range ? { range } : {}), volume: viewer.view.volume, text: '', hidden: false, color: participants.me?.color ?? '#56b4e9',
      author: participants.me?.name ?? '', value: quickValue({ kind, points }), unit: unitOf(kind, viewer.volume),
      data_unit: valueUnit(viewer.volume),
    };
    this.#changes.put({ id: item.id, before: null, after: item });
    this.#apply(item.id, item);
    this.select(item.id);
    return item;
  }

  /** Changes members. With `isDrag` the change belongs to a gesture, which end() ends. */
  edit(id, patch, { isDrag = false } = {}) {
    const before = this.#list.get(id);
    if (!before || !this.canEdit) return;
    if (isDrag && this.#gesture?.id !== id) this.#gesture = { id, before };
    const after = { ...before, ...patch };
    if (patch.points) after.value = quickValue(after) ?? before.value;
    if (!isDrag) this.#changes.put({ id, before, after });
    this.#list.put(after);
    if (!isDrag || !KINDS[before.kind].hasRange) this.#send(id, patch);
    this.#show();
  }

  /** Ends a drag. */
  end() {
    if (!this.#gesture) return;
    const { id, before } = this.#gesture;
    this.#gesture = null;
    const after = this.#list.get(id);
    if (after) this.#changes.put({ id, before, after });
    if (after && KINDS[after.kind].hasRange && after.points !== before.points) this.#send(id, { points: after.points });
    this.#show();
  }

  remove(id) {
    const before = this.#list.get(id);
    if (!before || !this.canEdit) return;
    this.#changes.put({ id, before, after: null });
    this.#apply(id, null);
  }

  undo() { if (this.canUndo) this.#return(this.#changes.undo()); }
  redo() { if (this.canRedo) this.#return(this.#changes.redo()); }

  #return({ id, item }) {
    this.#apply(id, item);
    if (item) this.select(id);
  }

  /** Makes the daemon's measurement equal to an item; null removes it. */
  #apply(id, item) {
    this.isNewest = true;
    if (item) {
      const { kind, ...members } = putParams(item);
      const isKnown = this.#list.get(id) !== null;
      this.#list.put(item);
      this.#send(id, isKnown ? members : { ...members, kind });
    } else {
      this.#list.remove(id);
      if (this.#selected === id) this.#selected = null;
      this.#send(id, null);
    }
    this.#show();
  }

  #joined() {
    const { session } = this.#app.connection;
    this.#list.clear(); // the daemon tells them again
    if (session?.id !== this.#session) this.#changes.clear();
    this.#session = session?.id ?? null;
    this.#show();
  }

  #show() {
    if (this.#selected && !this.selected) {
      this.#selected = null;
      this.handle = this.probe = null;
    }
    this.#findPaths();
    this.emit('change');
  }

  #send(id, patch) {
    const waiting = this.#queues.get(id);
    if (waiting) {
      Object.assign(waiting, patch ? { patch: { ...waiting.patch, ...patch }, isRemoval: false } : { patch: null, isRemoval: true });
      return;
    }
    const queue = { patch, isRemoval: !patch, tries: 0 };
    this.#queues.set(id, queue);
    this.#run(id, queue);
  }

  /** Sends what waits, one request after the other. */
  async #run(id, queue) {
    while (queue.patch || queue.isRemoval) {
      const { patch } = queue;
      queue.patch = null;
      queue.isRemoval = false;
      try {
        const answer = patch ? await this.#app.connection.call('measure.put', { id, ...patch }) : await this.#app.connection.call('measure.remove', { id });
        queue.tries = 0;
        if (patch && this.#list.get(id)) this.#list.put({ ...answer, ...queue.patch });
        this.#show();
      } catch (error) {
        if (error.code === OVER_A_LIMIT && queue.tries < TRIES) {
          queue.tries += 1;
          if (!queue.isRemoval) queue.patch = { ...patch, ...queue.patch };
          await pause(RETRY_MS);
        } else {
          await this.#refused(error);
          break;
        }
      }
      await pause(PAUSE_MS);
    }
    this.#queues.delete(id);
  }

  /** The daemon refused a change: the page returns to the daemon's list. */
  async #refused(error) {
    const { connection, notice } = this.#app;
    if (!connection.isLive) return;
    notice.show(t('measure.refused', { reason: error.message }), 'warning');
    try {
      const { measures } = await connection.call('measure.list');
      this.#list.take({ ids: measures.map(({ id }) => id), changed: measures });
      this.#show();
    } catch { /* the stream ended; after joining the daemon tells the list */ }
  }
}
