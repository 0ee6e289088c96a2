// SPDX-License-Identifier: Apache-2.0
// The section "Channels": the volume and other volumes on its grid in one picture, each with a colour and a window of its own. Channels are layers of
// the view (layers.js), so the undo and redo of layers serve them.
import {
  channelSources, channelsLeft, colorOf, colorsFor, isRgb, moveEnd, paint, rampOf, shownTogether, signalWindow, whyNoChannels, windowOf, windowsFor,
} from '../../core/channels.js';
import { showsVolume, isChannel } from '../../core/layers.js';
import { isProjection } from '../../core/projection.js';
import { t } from '../../core/text.js';
import { leastGap } from '../../core/transfer.js';
import { make, setAttribute, setText } from '../controls/dom.js';
import { showNumber } from '../controls/fields.js';
import { ChannelDetails } from './channels_details.js';
import { ChannelVolumes } from './channels_load.js';
import { hexOf, makeEye, makeRemover, onColor, onSlide, showEye } from '../layers/layers_rows.js';
import { ORDER } from '../shell/panel.js';

const ENDS = ['low', 'high'];
const OWN = 'volume'; // the key of the volume's row; the others have the ids of their volumes

export function install(app) {
  const section = new ChannelsSection(app);
  app.transfer.onShow(() => section.show());
}

/** What the rows show and change: the volume, and the layers of type channel. */
class Channels {
  #app; volumes;
  #wanted = ''; // the id of a volume that shows its own colours, if it has some, once it is shown

  constructor(app) {
    this.#app = app;
    this.volumes = new ChannelVolumes(app, () => app.transfer.plan());
  }

  get #view() { return this.#app.viewer.view; }

  /** [{key, index, name, isVisible, points (null: not known), extent, gap, histogram, hasCurve, set(points, time)}, …] */
  get list() {
    const { layers } = this.#app;
    return [this.#own(), ...layers.list.map((layer, index) => ({ layer, index })).filter(({ layer }) => isChannel(layer)).map(({ layer, index }) => this.#channel(layer, index))];
  }

  #ranged(channel, range) {
    const { points } = channel;
    const [from, to] = points ? windowOf(points) : [0, 1];
    const [low, high] = range ?? [from, to];
    const extent = [Math.min(low, from), Math.max(high, to)];
    return { ...channel, extent, gap: leastGap(extent) };
  }

  /** The volume of the view as a channel: its points are the points of the transfer function. */
  #own() {
    const { layers, transfer, viewer } = this.#app;
    const { points, map } = transfer.state;
    return this.#ranged({
      key: OWN, index: -1, name: viewer.volume?.fields?.[0]?.name || t('layers.volume'), isVisible: showsVolume(layers.list),
      points: map ? transfer.points : points, histogram: transfer.histogram, hasCurve: false, set: (changed, time) => transfer.edit({ points: changed, map: null }, { gesture: layers.gesture, time }),
    }, transfer.range);
  }

  #channel(layer, index) {
    const { layers } = this.#app;
    const { id } = layer;
    const known = this.volumes.find(id);
    const range = layers.volumeOf(layer)?.range ?? known?.range;
    const window = known?.window;
    const points = layer.points?.length ? layer.points : window ? rampOf(window, layer.color) : null;
    return this.#ranged({
      key: id, index, name: this.nameOf(id), isVisible: layer.visible, points, color: points ? colorOf(points) : layer.color,
      histogram: known?.histogram ?? null, hasCurve: true, set: (changed, time) => layers.change(index, { points: changed, color: colorOf(changed) }, time),
    }, range);
  }

  /** The name of the values, if the file of the picture has a field of that name. */
  nameOf(id) {
    const { layers, viewer } = this.#app;
    const name = layers.fieldName(id);
    return viewer.volume?.other_fields?.includes(name) ? name : layers.volumeName(id);
  }

  /** What may become a channel; see channelSources(). */
  get sources() {
    const { connection, layers, mayOpen, viewer } = this.#app;
    if (!viewer.volume) return [];
    return channelSources(viewer.volume, connection.volumes, layers.list).filter((source) => mayOpen || source.volume);
  }

  /** Mixes red, green and blue of a volume, if it has them, as soon as the picture shows it. */
  showColors(id) {
    this.#wanted = id;
    this.#app.transfer.plan();
  }

  /** True once if fields of the volume are wanted in their colours. */
  takeWish(fields) {
    const { layers, viewer } = this.#app;
    const { volume } = viewer;
    if (!this.#wanted || volume?.id !== this.#wanted || !viewer.isReady || !layers.isEditable) return false;
    this.#wanted = '';
    return this.list.length === 1 && isRgb([volume.fields?.[0]?.name ?? '', ...fields.map(({ field }) => field)]);
  }

  get left() { return channelsLeft(this.#app.layers.list); }

  /** The ids of the sources that can be loaded; says which cannot. */
  async #load(sources) {
    const { layers, notice } = this.#app;
    const shown = this.#view.volume;
    const ids = await Promise.all(sources.map(async ({ field, volume }) => {
      try {
        return volume ? volume.id : await this.volumes.load(shown, field);
      } catch (error) {
        notice.show(t('volumes.field.failed', { field, reason: error.message }), 'error', 'open');
        return '';
      }
    }));
    const isStill = this.#view?.volume === shown && layers.isEditable;
    return isStill ? ids.filter((id) => id && !layers.list.some((layer) => isChannel(layer) && layer.id === id)) : [];
  }

  /** Adds channels. With isAll, the volume of the view also gets a colour of its own. */
  async add(sources, isAll) {
    const { layers, transfer, viewer } = this.#app;
    const shown = this.#view.volume;
    const ids = await this.#load(sources);
    const signals = (await Promise.all([shown, ...ids].map((id) => this.volumes.ask(id)))).map((known) => known && signalWindow(known.histogram, known.window));
    if (!ids.length || viewer.view?.volume !== shown || !layers.isEditable) return;
    if (isAll && ids.length < sources.length && isRgb([layers.fieldName(shown), ...sources.map(({ field }) => field)])) return; // other colours
    const others = this.list.filter(({ index }) => index >= 0).map(({ color }) => color);
    const names = [shown, ...ids].map((id) => layers.fieldName(id));
    const [own, ...windows] = isAll ? windowsFor(names, signals) : signals;
    const [first, ...colors] = isAll ? colorsFor(names, others) : [null, ...colorsFor(names.slice(1), [...others, colorOf(transfer.points)])];
    const points = isAll ? rampOf(own ?? transfer.range, first) : null;
    layers.addChannels(ids.map((id, i) => ({ id, points: rampOf(windows[i] ?? [0, 1], colors[i]) })), points, performance.now());
    if (isAll) this.#fit();
  }

  /** Fits the whole volume, because the default camera fits what was visible of the volume alone. A camera that the user moved stays. */
  async #fit() {
    const { viewer } = this.#app;
    const home = await viewer.home();
    if (String(home?.target) === String(viewer.camera.target)) viewer.fit(performance.now());
  }
}

class ChannelsSection {
  #app; #channels; #details; #body; #list; #all; #source; #sourceRow; #progress; #said; #maximum;
  #selected = '';
  #key = '';
  #sources = [];

  constructor(app) {
    this.#app = app;
    this.#channels = new Channels(app);
    this.#details = new ChannelDetails(app.layers);
    this.#body = app.panel.section({ id: 'channels', title: t('channels.section'), order: ORDER.channels, isOpen: true });
    this.#list = make('ol', { id: 'channel-list', 'aria-label': t('channels.section') });
    this.#all = make('button', { id: 'channels-all', text: t('channels.all'), title: t('channels.all.title'), press: () => this.#channels.add(this.#fields, true) });
    this.#source = make('select', { id: 'channels-add' });
    this.#source.addEventListener('change', () => {
      const source = this.#sources[this.#source.selectedIndex - 1];
      this.#source.selectedIndex = 0;
      if (source) this.#channels.add([source], false);
    });
    this.#sourceRow = make('div', { class: 'row' }, make('label', { for: 'channels-add', text: t('channels.add') }), this.#source);
    this.#progress = make('progress', { max: 1, hidden: true, 'aria-label': t('channels.all') });
    this.#said = make('p', { class: 'about', role: 'status' });
    this.#maximum = make('button', {
      id: 'channels-maximum', text: t('channels.maximum'), title: t('channels.maximum.title'), 'aria-pressed': 'false', press: ({ timeStamp }) => this.#toggleMaximum(timeStamp),
    });
    this.#body.append(this.#list, this.#said, this.#progress, make('div', { class: 'buttons' }, this.#all, this.#maximum), this.#sourceRow);
    app.connection.on('volumes', () => app.transfer.plan());
    app.channels = this.#channels;
  }

  /** The other fields of the file that the view can still show. */
  get #fields() {
    const fields = this.#sources.filter(({ field }) => field);
    const together = shownTogether(this.#app.viewer.volume?.fields?.[0]?.name ?? '', fields.map(({ field }) => field));
    return fields.filter(({ field }) => together.includes(field)).slice(0, this.#channels.left);
  }

  #row({ key, index, name }) {
    const { layers } = this.#app;
    const of = () => this.#channels.list.find((one) => one.key === key);
    const eye = makeEye(name, ({ timeStamp }) => (
      index < 0 ? layers.showVolume(!of().isVisible, timeStamp) : layers.change(of().index, { visible: !of().isVisible }, timeStamp)));
    const color = make('input', { type: 'color', 'aria-label': t('channels.color', { name }) });
    onColor(layers, color, (value, time) => {
      const { points, set } = of();
      if (points) set(paint(points, value), time);
      else layers.change(of().index, { color: value }, time);
    });
    const pick = make('button', { class: 'layer-pick', press: () => this.#select(key) }, make('span', { class: 'layer-name', text: name, title: name }), make('span', { class: 'layer-value' }));
    const sliders = ENDS.map((end, i) => {
      const slider = make('input', { type: 'range', min: 0, max: 1, step: 0.001, 'data-end': end, 'aria-label': t(`channels.${end}`) });
      onSlide(layers, slider, (share, time) => {
        const { points, extent, gap, set } = of();
        set(moveEnd(points, i, layers.round(extent[0] + share * (extent[1] - extent[0]), extent), gap), time);
      });
      return slider;
    });
    const removed = index < 0 ? [] : [makeRemover(name, ({ timeStamp }) => this.#remove(key, timeStamp))];
    return make('li', { 'data-key': key, 'data-pointer': index < 0 ? false : `/layers/${index}` },
      make('div', { class: 'row' }, eye, color, pick, ...removed), make('span', { class: 'pair', role: 'group', 'aria-label': name }, ...sliders));
  }

  #remove(key, time) {
    const { layers } = this.#app;
    layers.remove(layers.list.findIndex((layer) => isChannel(layer) && layer.id === key), time);
    this.show();
    this.#list.querySelector('.layer-pick').focus();
  }

  /** Changes between the shaded mixture and the maximum along each ray, which microscopists are used to. */
  #toggleMaximum(time) {
    const { viewer } = this.#app;
    if (!viewer.mayChange()) return;
    viewer.change({ compositing: isProjection(viewer.view) ? { mode: 'sheet' } : { mode: 'maximum', colors: 'transfer_function' } }, time);
  }

  #select(key) {
    this.#selected = this.#selected === key ? '' : key;
    this.#app.transfer.plan();
  }

  show() {
    const { layers, transfer, viewer } = this.#app;
    if (!transfer.state) return;
    this.#sources = viewer.kind === 'grid' ? this.#channels.sources : [];
    const { progress } = this.#channels.volumes;
    const channels = viewer.kind === 'grid' ? this.#channels.list : [];
    const isOn = channels.length > 1 || this.#sources.length > 0 || progress !== null;
    this.#body.closest('details').hidden = !isOn;
    if (!isOn) return;
    this.#body.toggleAttribute('inert', !layers.isEditable);
    if (this.#channels.takeWish(this.#fields)) this.#channels.add(this.#fields, true);
    const key = JSON.stringify(channels.map((channel) => [channel.key, channel.index, channel.name]));
    if (key !== this.#key) {
      this.#key = key;
      this.#details.root.remove();
      this.#list.replaceChildren(...channels.map((channel) => this.#row(channel)));
    }
    channels.forEach((channel, i) => this.#showRow(this.#list.children[i], channel));
    this.#showAdding(progress);
  }

  #showRow(item, channel) {
    const { isVisible, points, extent: [low, high], key } = channel;
    const [, color, pick] = item.firstChild.children;
    showEye(item, isVisible);
    const hex = hexOf(points ? colorOf(points) : channel.color);
    if (color.value !== hex) color.value = hex;
    item.style.setProperty('--color', hex);
    const isSelected = key === this.#selected && points !== null;
    setAttribute(pick, 'aria-expanded', isSelected);
    pick.disabled = points === null;
    const window = points ? windowOf(points) : [low, high];
    setText(pick.lastChild, points ? t('layers.thresholds', { low: showNumber(window[0]), high: showNumber(window[1]) }) : '');
    [...item.children[1].children].forEach((slider, end) => {
      slider.disabled = points === null;
      slider.value = String((window[end] - low) / (high - low || 1));
      slider.setAttribute('aria-valuetext', showNumber(window[end]));
      item.children[1].style.setProperty(`--${ENDS[end]}`, slider.value);
    });
    const { root } = this.#details;
    if (isSelected) {
      if (root.parentElement !== item) item.append(root);
      this.#details.show(channel);
    } else if (root.parentElement === item) {
      root.remove();
    }
  }

  #showAdding(progress) {
    const { viewer } = this.#app;
    const why = whyNoChannels(viewer.view);
    const isFull = this.#channels.left === 0;
    this.#progress.hidden = progress === null;
    if (progress) this.#progress.value = progress.share;
    const text = progress ? t('channels.loading', progress) : why ? t(`channels.${why}`) : isFull && this.#sources.length ? t('channels.full') : '';
    setText(this.#said, text);
    this.#said.hidden = !text;
    const mayAdd = !progress && !why && !isFull;
    this.#all.hidden = this.#fields.length === 0;
    this.#maximum.hidden = this.#channels.list.length < 2;
    setAttribute(this.#maximum, 'aria-pressed', isProjection(viewer.view));
    this.#all.disabled = !mayAdd;
    this.#sourceRow.hidden = this.#sources.length === 0;
    this.#source.disabled = !mayAdd;
    const names = [t('channels.add.choose'), ...this.#sources.map(({ field, volume }) => field ?? this.#app.layers.volumeName(volume.id))];
    if (JSON.stringify(names) === this.#source.dataset.names) return;
    this.#source.dataset.names = JSON.stringify(names);
    this.#source.replaceChildren(...names.map((name) => new Option(name)));
  }
}
