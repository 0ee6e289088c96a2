// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import {
  EMPTY, KEYS_MAX, append, appendTurn, framesOf, isWhole, keyOf, lengthOf, move, pointerInto, remove, replace, requestOf, secondsAt, stretch,
  turnOf, uprightAxis, viewAt,
} from '../../../clients/web/core/keyframes.js';
import { applyPatch, patchBetween } from '../../../clients/web/core/merge.js';
import { dot, subtract } from '../../../clients/web/core/vector.js';
import { defaultView } from '../support/mock-daemon.mjs';
import { close } from '../support/numbers.mjs';

const OUTPUT = { size: [64, 48], fps: 10, format: 'webm', quality: 80 };
const lit = (background, more = {}) => ({ ...keyOf({ view: { ...defaultView('phantom'), background: [background, 0, 0, 1] } }), ...more });
const path = (keys, isLoop = false) => ({ keys, isLoop });
const reds = ({ keys }) => keys.map(({ view }) => view.background[0]);

test('keyframes are added, removed and reordered; the times between positions do not change', () => {
  const one = append(EMPTY, lit(0));
  const three = append(one, lit(0.5, { seconds: 1 }), lit(1, { seconds: 3, ease: 'smooth' }));
  assert.deepEqual([EMPTY.keys.length, one.keys.length, three.keys.length], [0, 1, 3]);
  assert.deepEqual([isWhole(one), isWhole(three)], [false, true]);
  const moved = move(three, 2, -1);
  assert.deepEqual(reds(moved), [0, 1, 0.5]);
  assert.deepEqual(moved.keys.map(({ seconds, ease }) => [seconds, ease]), three.keys.map(({ seconds, ease }) => [seconds, ease]));
  assert.equal(move(three, 0, -1), three);
  assert.equal(move(three, 2, 1), three);
  assert.deepEqual(reds(remove(three, 1)), [0, 1]);
  assert.deepEqual(replace(three, 1, { seconds: 9 }).keys.map(({ seconds }) => seconds), [2, 9, 3]);
  assert.deepEqual(reds(three), [0, 0.5, 1], 'the argument is not modified');
  assert.equal(append(EMPTY, ...Array(300).fill(lit(0))).keys.length, KEYS_MAX);
});

test('the last keyframe is the last frame; in a loop the first keyframe follows the last frame', () => {
  const open = path([lit(0), lit(0.5, { seconds: 1 }), lit(1, { seconds: 3 })]);
  assert.deepEqual([lengthOf(open), framesOf(open, 10)], [4, 41]);
  const { frames, keyframes } = requestOf(open, OUTPUT);
  assert.deepEqual([frames, keyframes.map(({ frame }) => frame)], [41, [10, 40]]);
  const round = { ...open, isLoop: true };
  assert.deepEqual([lengthOf(round), framesOf(round, 10)], [6, 60]);
  const back = requestOf(round, OUTPUT).keyframes;
  assert.deepEqual(back.map(({ frame, view }) => [frame, view.background[0]]), [[10, 0.5], [40, 1], [60, 0]]);
  // A length is rounded to a whole number of frames, and the last frame still equals the last keyframe.
  const odd = requestOf(path([lit(0), lit(1, { seconds: 0.97 })]), OUTPUT);
  assert.deepEqual([odd.frames, odd.keyframes[0].frame], [11, 10]);
  assert.equal(framesOf(path([lit(0), lit(1, { seconds: 0.1 })]), 1), 2);
  assert.equal(secondsAt(open, 10, 20), 2);
});

test('a frame is the view between its keyframes, with their easing', () => {
  const open = path([lit(0), lit(1, { seconds: 1, ease: 'smooth' }), lit(0, { seconds: 1, ease: 'step' })]);
  const red = (frame) => viewAt(open, 10, frame).background[0];
  close([0, 2.5, 5, 10, 19, 20].map(red), [0, 0.15625, 0.5, 1, 1, 0], 1e-12);
  const round = path([lit(0, { seconds: 2 }), lit(1, { seconds: 1 })], true);
  close([5, 10, 20, 30].map((frame) => viewAt(round, 10, frame).background[0]), [0.5, 1, 0.5, 0], 1e-12);
});

test('a request contains only what changes, as patches from keyframe to keyframe', () => {
  const plain = defaultView('phantom');
  const { c_max: _, ...automatic } = plain.filter;
  const keys = [
    { ...plain, filter: { ...plain.filter, c_max: 0.5 } }, { ...plain, filter: automatic },
    { ...plain, filter: automatic, camera: { ...plain.camera, fov_y: 40 }, background: [1, 1, 1, 1] },
  ].map((view) => keyOf({ view }));
  const { view, keyframes, ...rest } = requestOf(path(keys), OUTPUT);
  assert.deepEqual(rest, { ...OUTPUT, frames: 41 });
  assert.equal('size' in view, false);
  assert.equal(view.volume, 'phantom');
  assert.deepEqual(keyframes.map((key) => key.view), [
    { background: plain.background, camera: {}, filter: { c_max: null } },
    { background: [1, 1, 1, 1], camera: { fov_y: 40 }, filter: {} },
  ], 'each key names all that moves, so that nothing moves between two that are the same');
});

test('a patch between two values turns the first into the second', () => {
  const from = { a: 1, b: { c: [1, 2], d: { e: 1 } }, f: 'x' };
  const to = { a: 1, b: { c: [1], d: { e: 2 } }, g: null };
  const patch = patchBetween(from, to);
  assert.deepEqual(patch, { b: { c: [1], d: { e: 2 } }, f: null, g: null });
  assert.deepEqual(applyPatch(from, patch), { a: 1, b: { c: [1], d: { e: 2 } } });
  assert.deepEqual(patchBetween(from, structuredClone(from)), {});
});

test('JSON pointers of the daemon map to keyframes: the view and the end of a loop map to the first', () => {
  const open = path([lit(0), lit(1), lit(0)]);
  assert.equal(pointerInto(open, '/keyframes/1/view/camera'), '/keyframes/2/view/camera');
  assert.equal(pointerInto(open, '/view/clip/box'), '/keyframes/0/view/clip/box');
  assert.equal(pointerInto({ ...open, isLoop: true }, '/keyframes/2'), '/keyframes/0');
  assert.deepEqual(['/size/0', '/frames', '', '/keyframes'].map((pointer) => pointerInto(open, pointer)), ['/size/0', '/frames', '', '/keyframes']);
});

test('a new length scales all times', () => {
  const open = path([lit(0, { seconds: 4 }), lit(0.5, { seconds: 1 }), lit(1, { seconds: 3 })]);
  assert.deepEqual(stretch(open, 8).keys.map(({ seconds }) => seconds), [8, 2, 6]);
  assert.deepEqual(stretch(open, 0.04).keys.map(({ seconds }) => seconds), [0.1, 0.1, 0.1], 'each time is at least 0.1 s');
  for (const wrong of [0, -1, NaN, Infinity]) assert.equal(stretch(open, wrong), open);
});

test('a turntable has four keyframes, each a quarter turn about the target', () => {
  const view = defaultView('phantom');
  const turn = turnOf(view, [0, 2, 0]);
  assert.equal(turn[0], view);
  const arms = turn.map(({ camera }) => subtract(camera.position, camera.target));
  close(arms.map((arm) => Math.hypot(...arm)), [269, 269, 269, 269]);
  arms.forEach((arm, i) => close([dot(arm, arms[(i + 1) % 4])], [0], 1e-9));
  close(arms[1], [269, 0, 0], 1e-9);
  turn.forEach(({ camera }) => close(camera.up, [0, 1, 0]));
});

test('a turn begins at the last keyframe if that is the view now, and adds no keyframe twice', () => {
  const view = defaultView('phantom');
  const turn = turnOf(view, [0, 1, 0]).map((other) => keyOf({ view: other }));
  const other = keyOf({ view: { ...view, background: [1, 0, 0, 1] } });
  const names = ({ keys, isLoop }) => [keys.map((key) => (key === other ? 'other' : turn.findIndex((one) => one.view.camera.position.every((part, i) => part === key.view.camera.position[i])))), isLoop];
  const added = append(EMPTY, keyOf({ view: { ...view, size: [7, 7] } }));
  assert.deepEqual(names(appendTurn(EMPTY, turn)), [[0, 1, 2, 3], true]);
  assert.deepEqual(names(appendTurn(added, turn)), [[0, 1, 2, 3], true]);
  assert.deepEqual(names(appendTurn(append(EMPTY, other), turn)), [['other', 0, 1, 2, 3, 0], false]);
  assert.deepEqual(names(appendTurn(append(EMPTY, other, turn[0]), turn)), [['other', 0, 1, 2, 3, 0], false]);
  assert.deepEqual(names(appendTurn(appendTurn(EMPTY, turn), turn)), [[0, 1, 2, 3, 0, 1, 2, 3], true]);
});

test('the up axis is the axis of the volume that is closest to up, pointing up', () => {
  const half = [[10, 0, 0], [0, 5, 0], [0, 0, 20]];
  close(uprightAxis({ up: [0.1, -0.9, 0.5] }, half), [0, -1, 0]);
  close(uprightAxis({ up: [0.2, 0.1, 3] }, half), [0, 0, 1]);
});
