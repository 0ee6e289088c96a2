// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { choose, chooseShown, flatLimit, hideFlat, isChoice, matters, steepest, valueAt, whyIdle } from '../../../clients/web/core/choices.js';
import { applyPatch } from '../../../clients/web/core/merge.js';
import { logarithmic, quadratic } from '../../../clients/web/core/slider.js';
import { compare } from '../../support/compare.mjs';

const slabs = { compositing: { mode: 'slab' }, transfer_function: { order: 'post', points: [] }, filter: {} };

test('projections have their own choices, and each begins with its own window', () => {
  const mip = { compositing: { mode: 'maximum' } };
  assert.deepEqual(['/filter/mode', '/shading/occlusion', '/transfer_function/order', '/compositing/slab', '/compositing/mode', '/compositing/colors']
    .filter((pointer) => matters(mip, pointer)), ['/compositing/mode', '/compositing/colors']);
  assert.ok(!matters({ compositing: { mode: 'sum' } }, '/compositing/colors'));
  assert.ok(!matters({}, '/compositing/colors'));
  assert.deepEqual(choose(mip, '/compositing/mode', 'mean'), { compositing: { mode: 'mean', window: null } });
  assert.deepEqual(choose({ compositing: { mode: 'mean', colors: 'transfer_function' } }, '/compositing/mode', 'sum'),
    { compositing: { mode: 'sum', window: null, colors: 'grey' } });
});

test('zero and absorption belong to a sum, whose window changes its unit with absorption', () => {
  const sum = { compositing: { mode: 'sum' } };
  for (const pointer of ['/compositing/zero', '/compositing/absorption']) {
    assert.deepEqual([sum, { compositing: { mode: 'mean' } }, {}].map((view) => matters(view, pointer)), [true, false, false]);
    assert.equal(valueAt(sum, pointer), null);
  }
  assert.deepEqual(choose(sum, '/compositing/zero', -1000), { compositing: { zero: -1000 } });
  assert.deepEqual(choose(sum, '/compositing/absorption', 2e-5), { compositing: { absorption: 2e-5, window: null } });
  const xray = { compositing: { mode: 'sum', absorption: 2e-5 } };
  assert.deepEqual(choose(xray, '/compositing/absorption', 3e-5), { compositing: { absorption: 3e-5 } });
  assert.deepEqual(choose(xray, '/compositing/absorption', null), { compositing: { absorption: null, window: null } });
});

test('undo returns to a mode and its window, with all that the mode needs', () => {
  const sum = { compositing: { mode: 'sum' }, transfer_function: { order: 'post' } };
  assert.deepEqual(chooseShown(sum, { mode: 'sum', center: 1, width: 2 }), { compositing: { window: { center: 1, width: 2 } } });
  assert.deepEqual(chooseShown(sum, { mode: 'splat', center: null, width: null }),
    { compositing: { mode: 'splat', window: { center: null, width: null } }, transfer_function: { order: 'auto' } });
});

test('smoothing is automatic by default, and has an effect on shaded pixels that are classified', () => {
  assert.ok(isChoice('/shading/smoothing'));
  assert.equal(valueAt({ shading: { mode: 'phong' } }, '/shading/smoothing'), null);
  assert.deepEqual(choose({ shading: { smoothing: 0.5 } }, '/shading/smoothing', null), { shading: { smoothing: null } });
  const lit = { shading: { mode: 'phong' } };
  const views = [lit, { ...lit, ...slabs }, { shading: { mode: 'none' } }, { ...lit, transfer_function: { order: 'pre' } },
    { ...lit, compositing: { mode: 'splat' } }, { ...lit, compositing: { mode: 'mean' } }, { ...lit, filter: { sigma: 1 } },
    { ...lit, filter: { sigma: 1 }, transfer_function: { order: 'post' } }];
  assert.deepEqual(views.map((view) => matters(view, '/shading/smoothing')), [true, true, false, false, false, false, false, true]);
});

test('valueAt returns the value of the view, or the default of the protocol', () => {
  assert.equal(valueAt({}, '/filter/mode'), 'adaptive');
  assert.equal(valueAt({ filter: { sigma: 1.5 } }, '/filter/sigma'), 1.5);
  assert.equal(valueAt({ filter: { lowpass: 0 } }, '/filter/lowpass'), 0, 'zero is a value, not a missing one');
  assert.equal(valueAt(slabs, '/transfer_function/order'), 'post');
  assert.ok(isChoice('/compositing/slab'));
  assert.ok(!isChoice('/compositing'));
  assert.ok(!isChoice('/clip/box'));
  assert.ok(!isChoice('toString'));
});

test('a choice is idle when other choices make it irrelevant', () => {
  const idle = (view) => ['/filter/mode', '/filter/kernel', '/filter/sigma', '/filter/cutoff', '/filter/lowpass', '/compositing/mode',
    '/compositing/attenuation', '/compositing/slab', '/transfer_function/order'].filter((pointer) => !matters(view, pointer));
  assert.deepEqual(idle({}), ['/compositing/slab']);
  assert.deepEqual(idle(slabs), []);
  assert.deepEqual(idle({ ...slabs, filter: { kernel: 'cubic' } }), ['/filter/sigma', '/filter/cutoff']);
  assert.deepEqual(idle({ ...slabs, filter: { mode: 'reconstruction' } }), ['/filter/lowpass']);
  assert.deepEqual(idle({ ...slabs, filter: { mode: 'none' } }), ['/filter/kernel', '/filter/sigma', '/filter/cutoff', '/filter/lowpass']);
  assert.deepEqual(idle({ filter: { mode: 'swan' }, compositing: { mode: 'splat' } }), ['/compositing/slab']);
  assert.deepEqual(idle({ transfer_function: { order: 'post' } }), ['/filter/mode', '/filter/kernel', '/filter/sigma', '/filter/cutoff',
    '/filter/lowpass', '/compositing/slab'], 'sheets of interpolated values have no filter');
});

test('a choice gives a patch of one field', () => {
  assert.deepEqual(choose({}, '/filter/mode', 'none'), { filter: { mode: 'none' } });
  assert.deepEqual(choose({}, '/compositing/slab', 0.5), { compositing: { slab: 0.5 } });
  assert.deepEqual(choose({}, '/compositing/mode', 'splat'), { compositing: { mode: 'splat' } });
  assert.deepEqual(choose(slabs, '/transfer_function/order', 'pre'), { transfer_function: { order: 'pre' } });
});

test('of single splats and post-classification, the newer choice ends the other in the same patch', () => {
  assert.deepEqual(choose({}, '/transfer_function/order', 'post'), { transfer_function: { order: 'post' } });
  const splats = { compositing: { mode: 'splat' } };
  assert.deepEqual(choose(splats, '/transfer_function/order', 'post'), { transfer_function: { order: 'post' }, compositing: { mode: 'sheet' } });
  const after = applyPatch(slabs, choose(slabs, '/compositing/mode', 'splat'));
  assert.deepEqual([after.compositing.mode, after.transfer_function.order], ['splat', 'auto']);
  assert.deepEqual(after.transfer_function.points, [], 'other fields do not change');
  for (const mode of ['sheet', 'slab']) assert.deepEqual(choose(slabs, '/compositing/mode', mode), { compositing: { mode } });
});

test('a gradient axis that hides flat regions is recognised; another axis of the view is not', () => {
  assert.deepEqual(hideFlat(0), []);
  assert.equal(flatLimit(hideFlat(0)), 0);
  assert.equal(flatLimit(hideFlat(12.5)), 12.5);
  assert.equal(flatLimit(undefined), 0);
  for (const other of [[{ magnitude: 3, scale: 1 }], [{ magnitude: 0, scale: 0.5 }, { magnitude: 3, scale: 1 }],
    [{ magnitude: 0, scale: 0 }, { magnitude: 1, scale: 0.2 }, { magnitude: 3, scale: 1 }]]) {
    assert.equal(flatLimit(other), null);
  }
  assert.equal(steepest({ range: [-1000, 3000], spacing: [1, 0.5, 2] }), 4000);
});

test('sliders: ends are exact, both directions agree, and values outside the range are clamped', () => {
  for (const [scale, low, high] of [[logarithmic(0.05, 64), 0.05, 64], [quadratic(127.5), 0, 127.5], [quadratic(4000), 0, 4000]]) {
    assert.equal(scale.at(0), low);
    assert.equal(scale.at(1), Number(high.toPrecision(3)));
    for (let i = 0; i <= 100; i += 1) {
      compare(Math.abs(scale.of(scale.at(i / 100)) - i / 100), '<', 0.005, 'within half a step of the slider');
    }
    for (let i = 1; i <= 100; i += 1) compare(scale.at(i / 100), '>', scale.at((i - 1) / 100));
    assert.equal(scale.of(high * 10), 1);
    assert.equal(scale.at(2), scale.at(1));
  }
  assert.equal(logarithmic(0.05, 64).of(0.001), 0);
  compare(Math.abs(logarithmic(0.05, 64).of(1) - Math.log(20) / Math.log(1280)), '<', 1e-12);
  assert.equal(quadratic(0).of(5), 0, 'a volume with a single value');
  assert.equal(quadratic(0).at(0.5), 0);
});

test('ambient occlusion and shadows bring sheets that are classified by pixel; other modes end them', () => {
  const off = { compositing: { mode: 'slab' }, transfer_function: { order: 'pre' }, shading: { mode: 'phong', occlusion: 0, shadow: 0 } };
  const on = applyPatch(off, choose(off, '/shading/occlusion', 0.5));
  assert.deepEqual(on, { compositing: { mode: 'sheet' }, transfer_function: { order: 'auto' }, shading: { mode: 'phong', occlusion: 0.5, shadow: 0 } });
  for (const [pointer, value] of [['/compositing/mode', 'slab'], ['/compositing/mode', 'splat'], ['/transfer_function/order', 'pre']]) {
    const after = applyPatch(on, choose(on, pointer, value));
    assert.deepEqual(after.shading, { mode: 'phong', occlusion: 0, shadow: 0 });
    assert.equal(valueAt(after, pointer), value);
  }
  assert.deepEqual(choose(on, '/shading/occlusion', 0), { shading: { occlusion: 0 } });
  assert.deepEqual(choose(on, '/shading/shadow', 1).shading, { shadow: 1 });
  assert.equal(matters(on, '/shading/shadow'), true);
  assert.equal(matters({ ...on, shading: { mode: 'none' } }, '/shading/shadow'), false);
});

test('the transfer function is idle for a projection in grey and for surfaces alone', () => {
  const surface = { type: 'surface', value: 1 };
  assert.equal(whyIdle({}), null);
  assert.equal(whyIdle({ layers: [surface, { type: 'shell' }] }), null);
  assert.equal(whyIdle({ layers: [surface, { type: 'volume', visible: false }] }), 'surfaces');
  assert.equal(whyIdle({ layers: [{ type: 'gaussians' }, { type: 'geometry' }] }), 'surfaces');
  assert.equal(whyIdle({ layers: [{ type: 'gaussians' }, { type: 'points' }] }), null);
  assert.equal(whyIdle({ compositing: { mode: 'sum' } }), 'grey');
  assert.equal(whyIdle({ compositing: { mode: 'maximum', colors: 'transfer_function' } }), null);
});
