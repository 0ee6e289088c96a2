// SPDX-License-Identifier: Apache-2.0
// Computes the row of a record of what a user sees after the hand stops (record.mjs).
import { median, round } from '../serve/peers.mjs';
import { db } from './judge.mjs';

export const MOVE_S = 1; // of motion before each stop
export const LOOK_MS = 1500; // after it
const NEAR_DB = 1; // below the final value
const SHARP_DB = 36;
const TIMES_MS = [0, 50, 100, 150, 200, 300];

export const SETTLE_COLUMNS = ['client', 'move', 'volume', 'px', 'canvas', 'rtt_ms', 'mbit', 'stops', 'near_final_ms', 'sharp_ms', ...TIMES_MS.map((ms) => `db_${ms}`), 'db_final',
  'jump_levels', 'jump_percent', 'frames', 'first_ms', 'final_ms'];

/** The time from which all values are at least `least`; Infinity if the last one is not. */
function timeFrom(looks, least) {
  const last = looks.findLastIndex(({ value }) => value < least);
  return last + 1 < looks.length ? looks[last + 1].at : Infinity;
}

const valueAt = (looks, ms) => (looks.findLast(({ at }) => at <= ms) ?? looks[0]).value;

/** Judges one stop: {at (ms after the stop), image} in the order of time, the last one at rest. Gives {looks: [{at, value (dB over the object)}], jump, jumpPercent}. */
async function judgeStop(judge, { looks, wanted }) {
  const values = [];
  const changes = [];
  let known = null; // of the image before, which several looks may have
  for (const { at, image } of looks) {
    const isNew = known?.image !== image;
    if (isNew) known = { image, sums: await judge.compare(image, wanted) };
    changes.push(isNew && values.length ? known.sums.change : 0);
    values.push({ at, value: db(known.sums.object, known.sums.covered) });
  }
  const jump = Math.max(...changes);
  return { values, jump, jumpPercent: 100 * jump / changes.reduce((a, b) => a + b, 0) };
}

/** The row of a record {stops: [{looks, wanted, frames (how many came after the stop), first, final (ms)}]}. Medians over the stops. */
export async function settleRow(judge, { stops }) {
  const judged = [];
  for (const stop of stops) judged.push({ ...stop, ...await judgeStop(judge, stop) });
  const middle = (of, digits = 1) => round(median(judged.map(of).map((x) => (Number.isNaN(x) ? Infinity : x))), digits);
  const finalOf = ({ values }) => values.at(-1).value;
  return {
    stops: stops.length, near_final_ms: middle((one) => timeFrom(one.values, finalOf(one) - NEAR_DB), 0), sharp_ms: middle(({ values }) => timeFrom(values, SHARP_DB), 0),
    ...Object.fromEntries(TIMES_MS.map((ms) => [`db_${ms}`, middle(({ values }) => valueAt(values, ms))])), db_final: middle(finalOf),
    jump_levels: middle(({ jump }) => jump, 2), jump_percent: middle(({ jumpPercent }) => jumpPercent, 0), frames: middle(({ frames }) => frames),
    first_ms: middle(({ first }) => first, 0), final_ms: middle(({ final }) => final, 0),
  };
}
