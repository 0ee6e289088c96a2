// SPDX-License-Identifier: Apache-2.0
// Wires the page together: address → connection → frames → canvas, and input → view → connection.
import { Participants } from '../core/participants.js';
import { Connection } from '../core/connection.js';
import { FrameOrder } from '../core/order.js';
import { VideoStream, videoFormats } from '../core/video.js';
import { nextFrame, refreshRate } from './animation.js';
import { Banner, Notice } from './banner.js';
import { decodeImage } from './decoder.js';
import { showNumber } from './fields.js';
import { GradientPanel } from './gradient.js';
import { attachInput } from './input.js';
import { Keyframes } from './keyframes.js';
import { Panels } from './panels.js';
import { Paths } from './paths.js';
import { People } from './people.js';
import { Presets } from './presets.js';
import { Screen } from './screen.js';
import { StatusLine } from './status.js';
import { Transfer } from './transfer.js';
import { TransferFiles } from './transfer_files.js';
import { Viewer } from './viewer.js';
import { Warp } from './warp.js';
import { WindowLevel } from './window_level.js';

const RESIZE_MS = 120;
const LIST_MS = 500;

const base = new URL('.', location.href).href;
const place = `splatd:${new URL(base).pathname}`;

/** {token, session, volume, saved} from the address and from this tab's storage. Removes the token from the address. */
function readAddress() {
  const query = new URLSearchParams(location.search);
  const hash = new URLSearchParams(location.hash.slice(1));
  const get = (name) => query.get(name) ?? hash.get(name);
  const id = get('session');
  const given = get('token');
  if (given) {
    remember(id ? `join:${id}` : 'token', given);
    query.delete('token');
    hash.delete('token');
    const tail = (mark, params) => (String(params) ? mark + params : '');
    history.replaceState(null, '', location.pathname + tail('?', query) + tail('#', hash));
  }
  const token = recall('token') ?? '';
  if (id) return { token, volume: null, saved: null, session: { id, token: recall(`join:${id}`) ?? token, isJoined: true } };
  let session = null;
  try {
    session = JSON.parse(recall('session') ?? 'null');
  } catch { /* an unreadable entry counts as missing */ }
  const volume = get('volume');
  const isStale = volume || (given && given !== session?.daemon);
  const saved = get('view');
  return { token, volume, saved, session: isStale || saved ? null : session };
}

// The browser may forbid storage; then the page works without it.
function remember(key, value) {
  try {
    sessionStorage.setItem(`${place}${key}`, value);
  } catch { /* see above */ }
}

function recall(key) {
  try {
    return sessionStorage.getItem(`${place}${key}`);
  } catch {
    return null;
  }
}

const address = readAddress();
const element = (id) => document.getElementById(id);
const notice = new Notice(element('notice'));
const errors = [];
const drawn = { frame: 0, seq: 0, count: 0, videos: 0, width: 0, height: 0, isFinal: false, isLossless: false, isVideo: false };
let hasPicture = false;

function report(error) {
  errors.push(String(error?.message ?? error));
  if (errors.length > 20) errors.shift();
  notice.show(errors.at(-1), 'fault');
}
window.addEventListener('error', ({ error, message }) => report(error ?? message));
window.addEventListener('unhandledrejection', ({ reason }) => report(reason));

let configure = () => {};
const screen = new Screen(element('screen'), () => configure());

const connection = new Connection({
  base, ...address,
  lastView: () => viewer.lastView,
  size: () => screen.size,
  env: {
    fetch: (...args) => window.fetch(...args), WebSocket: window.WebSocket,
    setTimeout: (...args) => window.setTimeout(...args), clearTimeout: (id) => window.clearTimeout(id),
    now: () => performance.now(),
  },
});
const participants = new Participants();
const viewer = new Viewer({ connection, viewport: () => screen.viewport });
const warp = new Warp(element('warp'), screen);
const status = new StatusLine(element('status'), () => screen.size);
const help = () => (element('help').open ? element('help').close() : element('help').showModal());
const panels = new Panels(viewer, { help });
const banner = new Banner(element('banner'), {
  retry: () => connection.retryNow(),
  useToken: (token) => {
    remember('token', token);
    connection.useToken(token);
  },
});
const histogram = (isJoint) => connection.api.histogram(connection.session.id, connection.session.token, isJoint);
const transfer = new Transfer(viewer, {
  load: histogram, loadDefault: (id) => connection.api.volumeView(id), storage: { recall, remember },
});
new GradientPanel(transfer, { load: histogram });
new TransferFiles(transfer, { name: () => viewer.view?.volume ?? 'splatd' });
const windowLevel = new WindowLevel(transfer);
attachInput(element('screen'), viewer, { help, panel: () => panels.toggle(), pick, window: windowLevel });

/** Shows the value and position under a point of the viewport. */
async function pick(point) {
  const { width, height } = screen.viewport;
  const at = [point[0] * screen.size[0] / width, point[1] * screen.size[1] / height];
  try {
    const { position, value, opacity } = await connection.call('pick', { at });
    notice.show(position
      ? `Value ${showNumber(value)} at ${position.map(showNumber).join(', ')} ${viewer.volume?.unit ?? ''}`.trim()
      : `Nothing opaque here: opacity ${Math.round(opacity * 100)} %`);
  } catch (error) {
    notice.show(error.message);
  }
}

// Frames.

const video = new VideoStream({
  env: { VideoDecoder: window.VideoDecoder, EncodedVideoChunk: window.EncodedVideoChunk },
  toImage: (image, { width, height }) => createImageBitmap(image, 0, 0, width, height),
  askKey: () => connection.notify('stream.key', {}),
  giveUp: (error) => {
    report(new Error(`this browser cannot decode the video, images are used instead: ${error.message}`));
    remember('moving', 'jpeg');
    setMoving('jpeg');
  },
});
const order = new FrameOrder({
  decode: (frame) => (frame.isVideo ? video.decode(frame) : decodeImage(frame)),
  schedule: nextFrame,
  draw: (image, frame) => {
    screen.draw(image);
    drawn.videos += Number(frame.isVideo);
    Object.assign(drawn, { frame: frame.frame, seq: frame.seq, width: frame.width, height: frame.height,
      isFinal: frame.isFinal, isLossless: frame.isLossless, isVideo: frame.isVideo, count: drawn.count + 1 });
    status.drew(frame, viewer.updates.show(frame.seq));
    warp.drew(viewer.rigOf(frame.seq));
    showWarp();
    notice.hide('render');
    if (!hasPicture) {
      hasPicture = true;
      showState();
    }
  },
  ack: ({ frame }) => connection.notify('stream.ack', { frame }),
  fail: (error, { frame }) => report(new Error(`frame ${frame} could not be decoded: ${error.message}`)),
});
connection.on('frame', (frame) => order.put(frame));

// The frame size follows the window, at most every RESIZE_MS; the last size is always sent.
let configured = '';
let maxFps = 60;
let resizeTimer = null;
configure = () => {
  keyframes.show();
  if (resizeTimer || !connection.isLive) return;
  resizeTimer = setTimeout(() => {
    resizeTimer = null;
    sendConfigure();
  }, RESIZE_MS);
};
async function sendConfigure() {
  const { size } = screen;
  if (!connection.isLive || String(size) === configured) return;
  configured = String(size);
  await knowsFormats;
  try {
    const name = recall('name');
    await connection.call('stream.configure', { size, max_fps: maxFps, ...(name ? { name } : {}), ...wantedFormat() });
  } catch (error) {
    if (connection.isLive) report(new Error(`the daemon refused the frame size: ${error.message}`));
  }
  if (String(screen.size) !== configured) configure();
}

refreshRate().then(async (hertz) => {
  if (hertz === maxFps) return;
  maxFps = hertz;
  if (connection.isLive) await connection.call('stream.configure', { max_fps: maxFps }).catch((error) => connection.isLive && report(error));
});

// While the view moves: images, or video if browser and daemon support it. The choice belongs to this window.

const moving = element('moving');
const AUTO = 'auto'; // images, and video where the network is too slow for them
const MOVING_NAMES = { [AUTO]: 'automatic', vp9: 'video, VP9', vp8: 'video, VP8', h264: 'video, H.264' };
const CHEAPEST_FIRST = ['vp8', 'h264', 'vp9']; // in memory and CPU time of the daemon
const lossless = element('lossless'); // for a view at rest
let videos = [];
const formatOf = (choice) => (choice === AUTO ? ['jpeg', ...CHEAPEST_FIRST.filter((name) => videos.includes(name))] : [choice, 'jpeg']);
const wantedFormat = () => ({ format: formatOf(moving.value), lossless: lossless.checked });
const knowsFormats = videoFormats(window.VideoDecoder).then((names) => {
  videos = names;
  if (names.length === 0) return;
  moving.add(new Option(MOVING_NAMES[AUTO], AUTO), 0);
  for (const name of names) moving.add(new Option(MOVING_NAMES[name], name));
  const known = recall('moving');
  moving.value = [...moving.options].some(({ value }) => value === known) ? known : AUTO;
});
async function setMoving(choice) {
  moving.value = choice;
  if (!connection.isLive) return;
  try {
    const granted = await connection.call('stream.configure', { format: formatOf(choice) });
    if (granted.format === 'jpeg' && videos.includes(choice) && choice === moving.value) {
      moving.value = 'jpeg';
      notice.show(`The daemon has no ${MOVING_NAMES[choice]}: images are used instead.`);
    }
  } catch (error) {
    if (connection.isLive) report(error);
  }
}
moving.addEventListener('change', () => {
  remember('moving', moving.value);
  setMoving(moving.value);
});
lossless.checked = recall('lossless') === 'yes';
lossless.addEventListener('change', async () => {
  remember('lossless', lossless.checked ? 'yes' : 'no');
  if (connection.isLive) await connection.call('stream.configure', { lossless: lossless.checked }).catch((error) => connection.isLive && report(error));
});

// While the user is ahead of the pictures.

const showWarp = () => warp.show(viewer.rig, viewer.ahead, viewer.view?.background ?? [0, 0, 0, 1]);
viewer.on('camera', showWarp);
const warping = element('warping');
warping.checked = recall('warping') !== 'no';
warp.isOn = warping.checked;
warping.addEventListener('change', () => {
  remember('warping', warping.checked ? 'yes' : 'no');
  warp.isOn = warping.checked;
});

// Connection.

let last = { state: 'idle', reason: '', retryMs: 0, error: null };

function showState() {
  const { state, reason, retryMs, error } = last;
  status.setState(state);
  switch (state) {
    case 'live':
      if (hasPicture) banner.hide();
      else banner.show({ kind: 'busy', title: 'Waiting for the first picture …' });
      break;
    case 'waiting':
      showWaiting();
      break;
    case 'draining':
      banner.show({ kind: 'lost', title: 'The daemon is shutting down', text: reason });
      break;
    case 'lost':
      banner.showLost(reason, retryMs);
      break;
    case 'refused':
      showRefused(error);
      break;
    default: // After a lost connection the banner stays until a frame arrives.
      if (!hasPicture) banner.show({ kind: 'busy', title: 'Connecting …' });
  }
}

function showWaiting() {
  const { volumes } = connection;
  const loading = volumes.find((v) => v.state === 'loading');
  const failed = volumes.find((v) => v.state === 'failed');
  if (loading) {
    banner.show({ kind: 'wait', title: `Loading ${loading.name || loading.id} …`, progress: loading.progress ?? 0 });
  } else if (failed) {
    banner.show({
      kind: 'error', title: `${failed.name || failed.id} could not be loaded`,
      text: failed.reason || 'The daemon gave no reason.',
    });
  } else {
    banner.show({
      kind: 'wait', title: 'No volume is loaded',
      text: 'Start splatd with --volume PATH or --volume demo:phantom, or load one with splatctl.',
    });
  }
}

function showRefused(error) {
  if (error?.status === 401 && !connection.session?.isJoined) {
    banner.show({
      kind: 'error', title: connection.api.token ? 'The token is not valid' : 'A token is needed',
      text: 'splatd prints an address with a token when it starts; each start makes a new one unless --token-file '
        + 'is given. Open that address, or paste it here.',
      asksToken: true,
    });
  } else {
    banner.show({
      kind: 'error', title: 'The daemon refused the request', text: error?.message ?? '', canRetry: true,
      asksToken: error?.status === 403,
    });
  }
}

connection.on('state', (change) => {
  last = change;
  if (change.state !== 'live') warp.hide();
  if (change.state === 'live') {
    order.reset();
    video.reset();
    configured = '';
    participants.reset();
    sendConfigure();
    viewer.resume();
  } else if (change.state === 'lost' || change.state === 'refused') {
    viewer.suspend();
  }
  showState();
});
function rememberSession({ id, tokens, token }) {
  remember('session', JSON.stringify({ id, token: tokens?.control ?? token, daemon: connection.api.token }));
}

connection.on('session', (session) => {
  if (session.isNew) {
    rememberSession(session);
    // The session replaces the address: a reload returns to it.
    if (address.saved) history.replaceState(null, '', location.pathname);
  }
  viewer.adopt(session);
  transfer.retry();
  presets.refresh();
  paths.refresh();
});
connection.on('fault', report);

connection.on('notification', ({ method, params }) => {
  switch (method) {
    case 'stream.stats':
      status.setStats(params);
      break;
    case 'stream.policy':
      status.setPolicy(params);
      break;
    case 'view.changed':
      if (params.view && params.by !== participants.you) viewer.takeShared(params.view);
      break;
    case 'session.participants':
      participants.takeParticipants(params);
      showCompany();
      break;
    case 'session.control':
      participants.takeControl(params);
      showCompany();
      break;
    case 'volume.progress':
      refreshList();
      break;
    case 'render.error':
      warp.hide();
      notice.show(`The picture could not be rendered: ${params.message ?? 'no reason given'}`
        + `${params.pointer ? ` (${params.pointer})` : ''}`, 'render');
      break;
    default: // a message of a newer daemon
  }
});

// Participants.

/** Links for others; null where this client has no token for the link. */
function links() {
  const { session, api, isLive } = connection;
  const none = { watch: null, control: null, view: null, fork: null };
  if (!isLive || !session) return none;
  const join = (token) => token && (async () => `${base}#${new URLSearchParams({ session: session.id, token })}`);
  const keep = async () => `${base}#${new URLSearchParams({ view: (await api.keepView(viewer.view)).id })}`;
  return {
    watch: join(session.tokens?.view), control: join(session.tokens?.control),
    view: session.isJoined ? null : keep,
    fork: session.isJoined && !participants.hasControlRole ? null : fork,
  };
}

/** Continues in a new session of this client that starts with this view. */
async function fork() {
  const { session, api } = connection;
  const made = await api.sessionFrom(session.id, session.isJoined ? session.token : api.token);
  const own = session.isJoined ? `#${new URLSearchParams({ session: made.id, token: made.tokens.control })}` : '';
  if (!session.isJoined) rememberSession(made);
  history.replaceState(null, '', location.pathname + own);
  location.reload();
}

const people = new People(participants, {
  call: (method, params) => connection.call(method, params), fail: report, links,
  rename: (name) => {
    remember('name', name);
    connection.call('stream.configure', { name }).catch(report);
  },
});

const presets = new Presets(viewer, {
  api: () => (connection.session && !connection.session.isJoined ? connection.api : null), fail: report,
});

// Camera paths need a token of the daemon, which a client that joined by a link does not have.

const pathApi = () => (connection.api.token ? connection.api : null);
const paths = new Paths({
  api: pathApi, fail: report, say: (text) => notice.show(text),
  explain: (text) => {
    element('path-note').textContent = text;
    element('path-note').hidden = !text;
    element('path-making').hidden = Boolean(text);
  },
});
const keyframes = new Keyframes(viewer, {
  screen, api: pathApi, storage: { recall, remember }, made: (path) => paths.add(path),
  complain: (pointer, text) => panels.complain(pointer, text) || notice.show(text),
});

function showCompany() {
  viewer.allow(participants.mayChange);
  status.setParticipants(participants);
  people.show();
}

/** Why this participant may not change the view, or null. */
function whyNot() {
  if (viewer.canControl) return null;
  const { holder, hasControlRole } = participants;
  if (holder) return `${holder.name} has control. Ask for it under People to change this.`;
  return hasControlRole ? 'You cannot change the view now.' : 'Your link lets you watch. Ask for control under People to change this.';
}

// The panel follows the view.

viewer.on('view', (view) => {
  panels.showView(view);
  transfer.show(view, whyNot());
  panels.showVolumes(connection.volumes, view.volume);
  keyframes.show();
});
viewer.on('refused', ({ message, pointer }) => {
  if (pointer && panels.complain(pointer, message)) return;
  notice.show(`The daemon refused this change: ${message}${pointer ? ` (${pointer})` : ''}`);
});
connection.on('volumes', (volumes) => {
  panels.showVolumes(volumes, viewer.view?.volume);
  if (connection.state === 'waiting') showWaiting();
  if (connection.isLive && volumes.some((v) => v.state === 'loading')) refreshList();
});

let listTimer = null;
function refreshList() {
  if (listTimer || connection.session?.isJoined) return;
  listTimer = setTimeout(async () => {
    listTimer = null;
    try {
      if (connection.isLive) await connection.refresh();
    } catch { /* the stream reports a lost daemon */ }
  }, LIST_MS);
}

// Opening a link in a tab that already shows the page changes only the hash.
window.addEventListener('hashchange', () => location.reload());
window.addEventListener('online', () => connection.retryNow());
document.addEventListener('visibilitychange', () => {
  if (document.hidden) return;
  if (last.state === 'lost') connection.retryNow();
  refreshList();
});

/**
 * For tests and the console: read-only and not an interface. frame, seq: of the last drawn frame; count: frames drawn since
 * the page opened; videos: how many of them were video; sent: seq of the newest update.
 */
Object.defineProperty(window, 'splatd', {
  value: Object.freeze({
    get state() { return connection.state; },
    get frame() { return drawn.frame; },
    get seq() { return drawn.seq; },
    get count() { return drawn.count; },
    get videos() { return drawn.videos; },
    get isVideo() { return drawn.isVideo; },
    get size() { return [drawn.width, drawn.height]; },
    get wanted() { return screen.size; },
    get isFinal() { return drawn.isFinal; },
    get isLossless() { return drawn.isLossless; },
    get sent() { return viewer.updates.sent; },
    get isIdle() { return viewer.updates.isIdle; },
    get isWarped() { return warp.isVisible; },
    get camera() { return structuredClone(viewer.camera); },
    get canControl() { return viewer.canControl; },
    get people() { return participants.people; },
    get volume() { return viewer.view?.volume ?? null; },
    get background() { return structuredClone(viewer.view?.background ?? null); },
    get transfer() { return structuredClone(viewer.view?.transfer_function ?? null); },
    get session() { return connection.session?.id ?? null; },
    get latencyMs() { return status.latencyMs; },
    get stats() { return structuredClone(status.stats); },
    get errors() { return [...errors]; },
  }),
});

showState();
connection.start();
