// SPDX-License-Identifier: Apache-2.0
// The state that the panel and the handles of clipping share: the box, and all planes. The view has only the planes that are switched on.
import { Emitter } from '../../core/emitter.js';
import {
  PLANES_MAX, WHOLE, anchorOf, axisOf, axisPlane, depthOf, faceCoordinate, fractionAt, planeAt, planesOn, reconcile, sight,
} from '../../core/clip.js';
import { numberText, roundCoordinate, unitName } from '../../core/lengths.js';
import { t } from '../../core/text.js';
import { length } from '../../core/vector.js';
import { roundedAlong, unitAlong, worldFrom } from '../../core/vertical.js';

const DEPTH = 0.5; // of a new plane

/** Events: change (box, planes, selection, names, or whether the handles are visible). */
export class ClipState extends Emitter {
  #viewer; #storage; #orientation;
  #entries = [];
  #volume = null;
  #hasHandles = false;
  selected = 0;

  constructor({ viewer, storage, orientation }) {
    super();
    this.#viewer = viewer;
    this.#storage = storage;
    this.#orientation = orientation;
    viewer.on('view', () => this.#follow());
    orientation.on('change', () => this.emit('change'));
  }

  get box() { return this.#viewer.view?.clip?.box ?? WHOLE; }
  /** The list of {plane, isOn}. */
  get entries() { return this.#entries; }
  get isFull() { return this.#entries.length >= PLANES_MAX; }
  /** The box of the volume; null without a view. */
  get volumeBox() { return this.#viewer.box; }
  get unit() { return unitName(this.#viewer.volume?.unit); }
  /** The length of the diagonal of the volume. */
  get extent() { return this.#viewer.extent; }

  get hasHandles() { return this.#hasHandles; }
  set hasHandles(isOn) {
    if (isOn === this.#hasHandles) return;
    this.#hasHandles = isOn;
    this.emit('change');
  }

  #follow() {
    const { view } = this.#viewer;
    if (view.volume !== this.#volume) {
      this.#volume = view.volume;
      this.#entries = this.#recall();
      this.selected = 0;
    }
    this.#entries = reconcile(this.#entries, view.clip?.planes ?? []);
    this.selected = Math.max(0, Math.min(this.selected, this.#entries.length - 1));
    this.emit('change');
  }

  /** The planes of this tab that are off. */
  #recall() {
    try {
      const planes = JSON.parse(this.#storage.recall(`clip:${this.#volume}`) ?? '[]');
      return planes.map((plane) => ({ plane, isOn: false }));
    } catch {
      return [];
    }
  }

  #set(entries, time) {
    if (!this.#viewer.isReady) return;
    this.#entries = entries;
    const off = entries.filter(({ isOn }) => !isOn).map(({ plane }) => plane);
    this.#storage.remember(`clip:${this.#volume}`, JSON.stringify(off));
    const planes = planesOn(entries);
    if (JSON.stringify(planes) !== JSON.stringify(this.#viewer.view.clip?.planes ?? [])) this.#viewer.change({ clip: { planes } }, time);
    else this.emit('change');
  }

  setBox(box, time) {
    if (this.#viewer.isReady) this.#viewer.change({ clip: { box } }, time);
  }

  /** Moves a plane: entry `index` gets another plane. */
  setPlane(index, plane, time) {
    this.#set(this.#entries.map((entry, i) => (i === index ? { ...entry, plane } : entry)), time);
  }

  switchPlane(index, isOn, time) {
    this.#set(this.#entries.map((entry, i) => (i === index ? { ...entry, isOn } : entry)), time);
  }

  removePlane(index, time) {
    this.selected = Math.max(0, this.selected > index ? this.selected - 1 : this.selected);
    this.#set(this.#entries.filter((entry, i) => i !== index), time);
  }

  addPlane(plane, time) {
    if (this.isFull || !this.#viewer.isReady) return;
    this.selected = this.#entries.length;
    this.#set([...this.#entries, { plane, isOn: true }], time);
  }

  /** Adds a plane through the centre: across one of the volume's axes, or facing the viewer. */
  addAcross(axis, time) {
    if (this.#viewer.isReady) this.addPlane(axis === null ? this.#facing(DEPTH) : axisPlane(this.volumeBox, axis), time);
  }

  /** Turns the selected plane to the viewer, and keeps its depth; without planes it adds one. */
  faceViewer(time) {
    const entry = this.#entries[this.selected];
    if (!this.#viewer.isReady) return;
    if (!entry) this.addAcross(null, time);
    else {
      const plane = this.#facing(depthOf(this.volumeBox, entry.plane));
      this.#set(this.#entries.map((other, i) => (i === this.selected ? { plane, isOn: true } : other)), time);
    }
  }

  #facing(depth) {
    return planeAt(this.volumeBox, sight(this.#viewer.camera), depth);
  }

  select(index) {
    if (index === this.selected) return;
    this.selected = index;
    this.emit('change');
  }

  reset(time) {
    if (!this.#viewer.isReady) return;
    this.#entries = [];
    this.#storage.remember(`clip:${this.#volume}`, '[]');
    this.#viewer.change({ clip: { box: WHOLE, planes: [] } }, time);
  }

  // Names and numbers.

  /**
   * The names of both ends of one of the volume's axes, such as {name: 'R–L', label: 'From right to left', low: 'right', high: 'left'}. low: where
   * the axis begins; name and label go as the coordinates rise.
   */
  axisNames(axis) {
    const { anatomy } = this.#orientation;
    const { world, sign, isExact } = this.volumeBox ? axisOf(this.volumeBox, axis) : { world: axis, sign: 1, isExact: true };
    const rising = (ends) => (isExact && sign < 0 ? ends.toReversed() : ends);
    if (anatomy) {
      const ways = [-sign, sign];
      const [low, high] = ways.map((way) => this.#orientation.name(world, way));
      const [from, to] = rising([low, high]);
      return { name: rising(ways.map((way) => this.#orientation.letter(world, way))).join('–'), label: t('clip.between', { low: from, high: to }), low, high };
    }
    const own = isExact ? 'xyz'[world] : String(axis + 1);
    const [low, high] = rising([`−${own}`, `+${own}`]);
    return { name: t('clip.axis', { name: own }), label: t('clip.axis', { name: own }), low, high };
  }

  /** The name of the plane across an axis: sagittal, or x. */
  acrossName(axis) {
    const { world, isExact } = this.volumeBox ? axisOf(this.volumeBox, axis) : { world: axis, isExact: true };
    const { anatomy } = this.#orientation;
    if (!anatomy) return isExact ? 'xyz'[world] : String(axis + 1);
    return t(`clip.across.${'LR'.includes(anatomy[world]) ? 'sagittal' : 'PA'.includes(anatomy[world]) ? 'coronal' : 'axial'}`);
  }

  /** The world axis that one of the volume's axes lies along; -1 = none. */
  #worldOf(axis) {
    const { world, isExact } = this.volumeBox ? axisOf(this.volumeBox, axis) : { world: axis, isExact: true };
    return isExact ? world : -1;
  }

  /** The number of the file at a face of a box, rounded, and the reverse. axis: of the volume. */
  coordinate(axis, fraction) {
    return this.volumeBox ? roundedAlong(this.#viewer.volume, this.#worldOf(axis), faceCoordinate(this.volumeBox, axis, fraction), this.extent) : fraction;
  }

  fraction(axis, coordinate) { return fractionAt(this.volumeBox, axis, worldFrom(this.#viewer.volume, this.#worldOf(axis), coordinate)); }
  unitAlong(axis) { return unitAlong(this.#viewer.volume, this.#worldOf(axis)); }
  /** +1 or -1 if a normal lies along an axis z that has numbers of its own; else 0. */
  #scaledZ(normal) {
    const up = this.#viewer.volume?.vertical ? normal[2] / length(normal) : 0;
    return Math.abs(up) > 1 - 1e-6 ? Math.sign(up) : 0;
  }

  /** The distance of a plane from the origin, as {value, unit}: across a scaled z the number of the file. */
  positionAlong(normal, distance) {
    const sign = this.#scaledZ(normal);
    if (!sign) return { value: this.round(distance), unit: this.unit };
    return { value: roundedAlong(this.#viewer.volume, 2, sign * distance, this.extent), unit: unitAlong(this.#viewer.volume, 2) };
  }

  /** The reverse. */
  distanceAlong(normal, value) {
    const sign = this.#scaledZ(normal);
    return sign ? sign * worldFrom(this.#viewer.volume, 2, value) : value;
  }

  /** The same as text. */
  positionText(normal, distance) {
    const { value, unit } = this.positionAlong(normal, distance);
    return `${numberText(value)} ${unit}`.trim();
  }

  /** Where a plane is held: it turns about this point. */
  anchor(plane, index) { return anchorOf(this.volumeBox, plane, index); }
  round(value) { return roundCoordinate(value, this.extent); }
  /** A number with its unit. axis: of the volume, along which the number lies; null = a length. */
  withUnit(value, axis = null) { return `${numberText(value)} ${axis === null ? this.unit : this.unitAlong(axis)}`.trim(); }
}
