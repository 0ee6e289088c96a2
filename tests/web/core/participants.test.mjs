// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Participants } from '../../../clients/web/core/participants.js';

const person = (id, role = 'control') => ({ id, role, name: `N${id}`, color: `#00000${id}` });

function participants({ you = 2, holder = null, requests = [], roles = ['control', 'control', 'view'] } = {}) {
  const made = new Participants();
  made.takeParticipants({ you, participants: roles.map((role, i) => person(i + 1, role)) });
  made.takeControl({ holder, requests });
  return made;
}

test('only the holder may change the view, or without a holder every participant with the control role', () => {
  assert.equal(participants().mayChange, true);
  assert.equal(participants({ holder: 2 }).mayChange, true);
  assert.equal(participants({ holder: 1 }).mayChange, false);
  assert.equal(participants({ you: 3 }).mayChange, false);
  assert.equal(participants({ you: 3, holder: 3 }).mayChange, true, 'a grant is enough without the control role');
});

test('the holder may not request control, no participant twice, and a view role only while a participant can grant it', () => {
  assert.equal(participants({ holder: 1 }).mayAsk, true);
  assert.equal(participants({ holder: 2 }).mayAsk, false);
  assert.equal(participants({ holder: 1, requests: [{ id: 2, seconds: 5 }] }).mayAsk, false);
  assert.equal(participants({ you: 3 }).mayAsk, false);
  assert.equal(participants({ you: 3, holder: 1 }).mayAsk, true);
});

test('the list starts with this participant and marks the holder and the requests', () => {
  const list = participants({ holder: 1, requests: [{ id: 3, seconds: null }, { id: 2, seconds: 4 }] }).people;
  assert.deepEqual(list.map((p) => [p.id, p.name, p.isYou, p.isHolder, p.asks]), [
    [2, 'N2', true, false, { seconds: 4 }], [1, 'N1', false, true, null], [3, 'N3', false, false, { seconds: null }]]);
  assert.equal(participants({ holder: 1 }).holder.id, 1);
});

test('before the first message and after a loss the list is empty', () => {
  const empty = new Participants();
  assert.deepEqual([empty.count, empty.people, empty.holder, empty.me, empty.isHolder, empty.isAsking], [0, [], null, null, false, false]);
  const lost = participants({ holder: 2 });
  lost.reset();
  assert.deepEqual([lost.count, lost.isHolder, lost.mayChange], [0, false, true]);
});

test('a participant of an older daemon, without name and colour, gets defaults', () => {
  const old = new Participants();
  old.takeParticipants({ you: 7, participants: [{ id: 7, role: 'view' }] });
  assert.equal(old.people[0].name, 'Guest 7');
  assert.match(old.people[0].color, /^#[0-9a-f]{6}$/);
});
