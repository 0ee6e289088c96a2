// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { captureView, fitSize, overlayPlacement, readProgress, sizeProblem } from '../../../clients/web/core/capture.js';

test('a size is checked against the side and the pixels that the daemon allows', () => {
  assert.equal(sizeProblem([3840, 2160], 8294400), null);
  assert.deepEqual(sizeProblem([3840, 2161], 8294400), { code: 'pixels', limit: 8294400 });
  for (const bad of [[0, 5], [5, 8193], [1.5, 5], [NaN, 5], [-1, 5]]) assert.equal(sizeProblem(bad, 1e9).code, 'side');
  assert.deepEqual(fitSize([3840, 2160], 8294400), [3840, 2160]);
  const [width, height] = fitSize([3840, 2160], 1e6);
  assert.ok(width * height <= 1e6 && width * height > 0.99e6);
  assert.ok(Math.abs(width / height - 16 / 9) < 0.01);
  assert.deepEqual(fitSize([1, 100000], 1e9), [1, 8192]);
});

test('only a transparent capture changes the background', () => {
  const view = { volume: 'v', size: [1, 1], background: [1, 1, 1, 1] };
  assert.deepEqual(captureView(view, [3, 4], true), { volume: 'v', size: [3, 4], background: [0, 0, 0, 0] });
  assert.deepEqual(captureView(view, [3, 4], false).background, [1, 1, 1, 1]);
  assert.deepEqual(view.size, [1, 1]);
});

test('the overlay keeps its height and its centre', () => {
  assert.deepEqual(overlayPlacement({ width: 800, height: 600 }, [1600, 1200]), { scale: 2, x: 0, y: 0 });
  assert.deepEqual(overlayPlacement({ width: 800, height: 600 }, [600, 600]), { scale: 1, x: -100, y: 0 });
});

test('progress is told for every chunk', async () => {
  const told = [];
  const answer = new Response(new Blob(['hello ', 'world']), { headers: { 'Content-Length': '11' } });
  const chunks = await readProgress(answer, (...progress) => told.push(progress));
  assert.equal(Buffer.concat(chunks).toString(), 'hello world');
  assert.deepEqual(told.at(-1), [11, 11]);
  await readProgress(new Response('abc'), (received, total) => told.push([received, total]));
  assert.deepEqual(told.at(-1), [3, 0]);
});
