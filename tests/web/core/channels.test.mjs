// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import {
  CHANNELS_MAX, COLORS, addChannels, channelSources, channelsLeft, colorOf, colorsFor, fade, isSameGrid, moveEnd, moveWindow, nextColor, opacityOf,
  paint, patchForChannels, rampOf, shownTogether, signalWindow, whyNoChannels, windowOf, windowsFor,
} from '../../../clients/web/core/channels.js';
import { allows, choose, matters, whyIdle } from '../../../clients/web/core/choices.js';
import { addSurface, isSameLayers, showVolumeAlone, showsOthers } from '../../../clients/web/core/layers.js';

const VOLUME = { type: 'volume', visible: true };
const [GREEN, MAGENTA] = COLORS;
const channel = (id, more = {}) => ({ type: 'channel', visible: true, id, color: GREEN, points: rampOf([0, 10], GREEN), ...more });
const grid = (id, more = {}) => ({ id, state: 'ready', dims: [4, 4, 4], spacing: [1, 1, 1], origin: [0, 0, 0], direction: [[1, 0, 0], [0, 1, 0], [0, 0, 1]], ...more });

test('a window, a colour and an opacity change the points of a channel', () => {
  assert.equal(opacityOf(rampOf([10, 20], GREEN)), 0.95, 'a new channel is as bright as it can be');
  const ramp = rampOf([10, 20], GREEN, 0.5);
  assert.deepEqual(ramp, [{ value: 10, color: GREEN, opacity: 0 }, { value: 20, color: GREEN, opacity: 0.5 }]);
  assert.deepEqual(windowOf(moveEnd(ramp, 0, 15, 1)), [15, 20]);
  assert.deepEqual(windowOf(moveEnd(ramp, 0, 25, 1)), [25, 26], 'an end pushes the other one');
  assert.deepEqual(windowOf(moveEnd(ramp, 1, 5, 1)), [4, 5]);
  const bent = [ramp[0], { value: 12.5, color: GREEN, opacity: 0.1 }, ramp[1]];
  assert.deepEqual(moveWindow(bent, [0, 40], 1).map(({ value }) => value), [0, 10, 40]);
  assert.deepEqual(windowOf(moveWindow([ramp[1]], [0, 40], 1)), [0, 40], 'a single point becomes a ramp');
  assert.deepEqual(colorOf(paint(bent, MAGENTA)), MAGENTA);
  assert.equal(opacityOf(fade(bent, 0.25)), 0.25);
  assert.deepEqual(fade(bent, 0.25).map(({ opacity }) => opacity), [0, 0.05, 0.25]);
  assert.deepEqual(fade(fade(bent, 0), 0.5).map(({ opacity }) => opacity), [0, 0.1, 0.5], 'the shape stays');
  assert.deepEqual(fade(paint(rampOf([0, 1], GREEN, 0), GREEN), 0.3).map(({ opacity }) => opacity), [0, 0.3]);
  for (const value of [0, 7, -3e4, 1e30]) {
    const [low, high] = windowOf(rampOf([value, value], GREEN));
    assert.ok(high > low, `a window of one value ${value}`);
  }
});

test('channels get the next free colour, up to the limit of a view', () => {
  assert.deepEqual(nextColor([]), GREEN);
  assert.deepEqual(nextColor([GREEN, [1, 0.001, 1]]), COLORS[2]);
  assert.equal(channelsLeft([VOLUME]), CHANNELS_MAX);
  assert.equal(channelsLeft([VOLUME, channel('a'), { type: 'surface' }]), 5);
  assert.equal(channelsLeft([channel('a')]), CHANNELS_MAX - 1);
  const full = addChannels([VOLUME], Array.from({ length: 9 }, (_, i) => ({ id: `c${i}`, points: rampOf([0, 1], MAGENTA) })));
  assert.equal(full.length, 8);
  assert.deepEqual(full[7], { type: 'channel', visible: true, id: 'c6', color: MAGENTA, points: rampOf([0, 1], MAGENTA) });
  assert.equal(channelsLeft(full), 0);
});

test('channels that are called as colours get them, and red, green and blue share a window', () => {
  const [red, green, blue] = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
  assert.deepEqual(colorsFor(['red', 'green', 'blue'], []), [red, green, blue]);
  assert.deepEqual(colorsFor(['scan Blue', 'scan_RED', 'Ch 3 green'], []), [blue, red, green], 'the last word counts');
  assert.deepEqual(colorsFor(['DAPI', 'green', 'infrared', 'GFP'], [COLORS[2]]), [MAGENTA, green, COLORS[3], red], 'others get what is left');
  assert.deepEqual(colorsFor(['', '2'], []), [GREEN, MAGENTA]);
  assert.deepEqual(colorsFor(['red', 'red'], [red]), [red, red], 'a name wins over what is used');
  const windows = [[3, 90], null, [5, 200], [255, 256]];
  assert.deepEqual(windowsFor(['red', 'green', 'blue', 'alpha'], windows), [[3, 200], [3, 200], [3, 200], [255, 256]]);
  assert.deepEqual(windowsFor(['red', 'green', 'blue'], [null, null, null]), [null, null, null]);
  assert.deepEqual(windowsFor(['red', 'green', 'DAPI'], windows.slice(0, 3)), windows.slice(0, 3), 'not a picture in colours');
  assert.deepEqual(shownTogether('red', ['green', 'blue', 'alpha']), ['green', 'blue']);
  assert.deepEqual(shownTogether('alpha', ['beta']), ['beta']);
  assert.deepEqual(shownTogether('t', ['alpha', 'red']), ['alpha', 'red']);
});

test('the fields of the file and volumes on the same grid may become channels', () => {
  const cells = grid('cells', { source: 'cells.vtk', fields: [{ name: 'a' }], other_fields: ['b', 'c'] });
  const field = grid('cells-b', { source: 'cells.vtk?field=b', fields: [{ name: 'b' }] });
  const same = grid('same', { source: 'same.nrrd' });
  const volumes = [cells, field, same, grid('far', { origin: [1, 0, 0] }), grid('busy', { state: 'loading' }), grid('points', { kind: 'points' }), { id: 'new', state: 'ready' }];
  assert.deepEqual(channelSources(cells, volumes, [VOLUME]), [{ field: 'b' }, { field: 'c' }, { volume: same }]);
  assert.deepEqual(channelSources(cells, volumes, [VOLUME, channel('cells-b'), channel('same')]), [{ field: 'c' }]);
  assert.ok(isSameGrid(cells, grid('other')));
  assert.ok(!isSameGrid(cells, grid('other', { dims: [4, 4, 5] })));
  const large = grid('large', { whole: { dims: [8, 8, 8], spacing: [0.5, 0.5, 0.5] } });
  assert.ok(!isSameGrid(cells, large), 'the grid of all samples counts');
  assert.ok(isSameGrid(grid('fine', { dims: [8, 8, 8], spacing: [0.5, 0.5, 0.5] }), large));
});

test('a view with channels has colours in projections, and nothing that cannot be mixed', () => {
  const [without, having] = [[VOLUME], [VOLUME, channel('a')]];
  const grey = { compositing: { mode: 'maximum', colors: 'grey' }, transfer_function: { order: 'pre' } };
  assert.deepEqual(patchForChannels(grey, without, having), { compositing: { colors: 'transfer_function' }, transfer_function: { order: 'auto' } });
  assert.equal(patchForChannels(grey, having, having), null, 'grey was chosen with channels');
  assert.equal(patchForChannels({ compositing: { mode: 'sum' } }, without, having), null, 'a sum has no colours');
  assert.equal(patchForChannels({}, without, [VOLUME, channel('a', { visible: false })]), null);
  const colorsAfter = (compositing, mode, layers) => choose({ compositing, layers }, '/compositing/mode', mode).compositing.colors;
  assert.equal(colorsAfter({ mode: 'sheet' }, 'maximum', having), 'transfer_function');
  assert.equal(colorsAfter({ mode: 'sum' }, 'mean', having), 'transfer_function');
  assert.equal(colorsAfter({ mode: 'maximum' }, 'mean', having), undefined, 'grey stays grey');
  assert.equal(colorsAfter({ mode: 'maximum', colors: 'transfer_function' }, 'sum', having), 'grey');
  assert.equal(colorsAfter({ mode: 'sheet' }, 'maximum', without), undefined);
  const view = { layers: having, shading: { mode: 'phong' } };
  for (const [pointer, value] of [['/compositing/mode', 'splat'], ['/transfer_function/order', 'pre']]) {
    assert.equal(allows(view, pointer, value), false);
    assert.equal(allows({ layers: without }, pointer, value), true);
  }
  assert.equal(allows(view, '/compositing/mode', 'slab'), true);
  assert.deepEqual([matters(view, '/shading/shadow'), matters({ ...view, layers: without }, '/shading/shadow')], [false, true]);
  assert.equal(whyIdle({ layers: [{ ...VOLUME, visible: false }, channel('a')] }), 'surfaces');
  assert.equal(whyNoChannels({ edits: [{ type: 'box' }, { type: 'part' }] }), 'parts');
  assert.equal(whyNoChannels({ edits: [{ type: 'box' }] }), null);
});

test('channels belong to the volume beside other layers', () => {
  const surface = { type: 'surface', visible: true, value: 3 };
  assert.equal(showsOthers([VOLUME, channel('a')]), false);
  assert.deepEqual(showVolumeAlone([{ ...VOLUME, visible: false }, channel('a'), surface]).map(({ visible }) => visible), [false, true, false]);
  assert.deepEqual(addSurface([VOLUME, channel('a')], 3).map(({ visible }) => visible), [true, true, true], 'the mixture stays');
  assert.ok(isSameLayers([channel('a')], [channel('a', { points: rampOf([0, 10 + 1e-9], GREEN) })]));
  assert.ok(!isSameLayers([channel('a')], [channel('a', { points: rampOf([0, 11], GREEN) })]));
  assert.ok(!isSameLayers([channel('a')], [channel('a', { points: [] })]));
});

test('the window of a new channel leaves out the background', () => {
  const counts = Array.from({ length: 256 }, (_, i) => Math.round(1e6 * Math.exp(-((i - 10) ** 2) / 8)) + (i > 10 && i < 200 ? 20 : 0));
  const [low, high] = signalWindow({ range: [0, 2560], counts }, [0, 1]);
  assert.ok(low > 150 && low < 250 && high > 1900 && high <= 2000, `${low} – ${high}`);
  assert.deepEqual(signalWindow(null, [3, 4]), [3, 4]);
  assert.deepEqual(signalWindow({ range: [0, 1], counts: [1, 1, 1, 9] }, [3, 4]), [3, 4], 'no background');
});
