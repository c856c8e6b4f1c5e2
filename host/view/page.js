/* The viewer's page: a camera that follows mouse, touch and keys, requests for its pictures, the
 * scene's cameras with their photos. The crop box is crop.js's, the camera path and its film are
 * path.js's, the panel of a training is training.js's; these come before. Poses are camera to
 * world in the scene's units with OpenCV's axes (right, down, forward), as the server takes
 * them. */
'use strict';

const $ = (id) => document.getElementById(id);
const picture = $('picture'), overlay = $('overlay');
const pen = picture.getContext('2d', {alpha: false}), lines = overlay.getContext('2d');
const MOVING_MS = 45;   /* what a picture may take at the server while the camera moves */
const BETTER_MS = 300;  /* and the one after that, before the sharp one */
const WHOLE_MS = 450;   /* of a training under way: one moment of it, instead of the sharp one */
const STILL_MS = 160;   /* of no motion before a sharper one is asked for */
const MOST_PIXELS = 1 << 22;
const NO_CAMERA = $('camera-name').textContent;
const bytes = crypto.getRandomValues(new Uint8Array(8));
const viewer = 'v' + Array.from(bytes, (b) => b.toString(16).padStart(2, '0')).join('');

/* ---- vectors, rotations ---- */

const add = (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0]];
const scale = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
const size = (a) => Math.sqrt(dot(a, a));
const unit = (a) => scale(a, 1 / (size(a) || 1));
const clamp = (x, low, high) => Math.min(high, Math.max(low, x));

/* v turned about the unit vector n. */
function turn(v, n, angle) {
  const c = Math.cos(angle), s = Math.sin(angle);
  return add(add(scale(v, c), cross(n, v), s), n, dot(n, v) * (1 - c));
}

/* A camera: p position, r = [right, down, forward], distance to what it turns about, fov in degrees
 * of the picture's shorter side. */
const copy = (c) => ({p: [...c.p], r: c.r.map((v) => [...v]), distance: c.distance, fov: c.fov});
const pivot = (c) => add(c.p, c.r[2], c.distance);

function straighten(c) {
  c.r[2] = unit(c.r[2]);
  c.r[0] = unit(add(c.r[0], c.r[2], -dot(c.r[0], c.r[2])));
  c.r[1] = cross(c.r[2], c.r[0]);
}

const toPose = (c) => [0, 1, 2].flatMap((a) => [c.r[0][a], c.r[1][a], c.r[2][a], c.p[a]]);
const fromPose = (m) => ({
  p: [m[3], m[7], m[11]],
  r: [0, 1, 2].map((k) => [m[k], m[4 + k], m[8 + k]]),
});

function toQuaternion(r) { /* [w, x, y, z] of the matrix with columns r */
  const m = (i, j) => r[j][i], t = m(0, 0) + m(1, 1) + m(2, 2);
  if (t > 0) {
    const s = 2 * Math.sqrt(t + 1);
    return [s / 4, (m(2, 1) - m(1, 2)) / s, (m(0, 2) - m(2, 0)) / s, (m(1, 0) - m(0, 1)) / s];
  }
  const i = m(0, 0) > m(1, 1) ? (m(0, 0) > m(2, 2) ? 0 : 2) : (m(1, 1) > m(2, 2) ? 1 : 2);
  const j = (i + 1) % 3, k = (i + 2) % 3;
  const s = 2 * Math.sqrt(Math.max(1e-12, 1 + m(i, i) - m(j, j) - m(k, k)));
  const q = [(m(k, j) - m(j, k)) / s, 0, 0, 0];
  q[1 + i] = s / 4;
  q[1 + j] = (m(j, i) + m(i, j)) / s;
  q[1 + k] = (m(k, i) + m(i, k)) / s;
  return q;
}

function fromQuaternion(q) {
  const n = Math.hypot(...q), [w, x, y, z] = q.map((v) => v / n);
  return [[1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
    [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
    [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)]];
}

/* ---- state ---- */

let facts = null, camera = null, home = null;
let at = -1;            /* the scene's camera that the view is, or -1 */
let goal = -1;          /* the one that it flies to, or -1 */
let photo = null;       /* its photo, when it is here */
let coming = null;      /* the photo that is being fetched */
let last = null;        /* the newest picture: bitmap and numbers */
let version = 0, moved = 0, busy = false, abort = null, flight = null;
let keyframes = [], playing = 0;
let training = null;    /* how it stands, as the server told it last */
let ended = false;
let server = null;      /* the name of the one that the page is of */
let left = false;       /* another one has its address */

const gone = () => facts && facts.training ? 'The training has ended, or the way to it is cut. ' +
  `What it has made is shown by: cl-nascent view ${facts.run}` :
  'The viewer does not answer: it has ended, or the way to it is cut.';

let quiet = 0;

/* Shows a message for as long as it takes to read, or, lasting, until the next one. */
function say(text, lasting = false) {
  clearTimeout(quiet);
  if ($('message').textContent !== text) $('message').textContent = text;
  if (text && !lasting) quiet = setTimeout(() => say(''), 3000 + 60 * text.length);
  if (text && !lasting) write('said', text); /* to be read later */
  $('said').hidden = !$('said').textContent;
}

/* A text that is the same stays: screen readers take any change for news. */
function write(id, text) {
  if ($(id).textContent !== text) $(id).textContent = text;
}

/* For those who do not see what has changed. */
const tell = (text) => write('told', text);

/* Resolves while the page is seen: at once, or when its tab is shown again. */
const seen = () => new Promise((done) => {
  if (!document.hidden) done();
  else document.addEventListener('visibilitychange', done, {once: true});
});

function background() {
  const hex = $('background').value;
  return [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16) / 255);
}

function setBackground(colour) {
  $('background').value = '#' + colour.map((v) => Math.round(255 * clamp(v, 0, 1)).toString(16)
    .padStart(2, '0')).join('');
  refreshPhoto();
}

/* The picture's size in pixels, and its focal length. */
function frame() {
  const box = picture.getBoundingClientRect();
  let factor = Number($('size').value);
  factor = Math.min(factor, Math.sqrt(MOST_PIXELS / Math.max(1, box.width * box.height)));
  const width = Math.max(16, Math.round(box.width * factor));
  const height = Math.max(16, Math.round(box.height * factor));
  const focal = Math.min(width, height) / 2 / Math.tan(camera.fov * Math.PI / 360);
  return {width, height, focal, factor};
}

/* Where the picture of one of the scene's cameras stands in the window, in canvas pixels. */
function inset(f) {
  const c = facts.cameras[at], s = Math.min(f.width / c.width, f.height / c.height);
  const width = Math.max(1, Math.round(c.width * s)), height = Math.round(c.height * s);
  return {x: (f.width - width) / 2, y: (f.height - height) / 2, width, height};
}

/* The camera has changed. keep: it still is the scene's camera, or only looks have changed; moving:
 * by a flight or the path that plays, which any other change of the camera ends. */
function touch(keep = false, moving = false) {
  if (!keep && !moving) stopMotion();
  if (!keep && at >= 0) leaveCamera();
  version++;
  moved = performance.now();
  if (abort && abort.refining) abort.abort();
  $('fov').value = camera.fov;
  write('fov-text', `${camera.fov.toFixed(0)}°`);
  drawLines();
  pump();
}

/* ---- pictures ---- */

function cameraQuery(f) {
  if (at >= 0) {
    const box = inset(f);
    return {view: at, width: box.width, ...cropQuery()};
  }
  return {pose: toPose(camera).join(','), focal: f.focal, width: f.width, height: f.height,
    ...cropQuery()};
}

/* What a picture looks like, besides its camera. */
const looks = () => ({show: $('show').value, background: background().join(',')});

/* Requests name the server that the page is of: the port may be another viewer's by now. */
async function request(path, options = {}) {
  const headers = {...options.headers, ...(server ? {'X-Server': server} : {})};
  const answer = await fetch(path, {...options, headers});
  if (answer.status === 410) leave();
  return answer;
}

function ask(path, query, name, signal) {
  return request(path + '?' + new URLSearchParams(query), {headers: {'X-Viewer': name}, signal});
}

function post(path, query, more) {
  return request(path + '?' + new URLSearchParams(query),
    {method: 'POST', headers: {'X-Viewer': viewer}, ...more});
}

/* What the viewer says of a request that it refused; other programs answer for it, too, as a proxy
 * behind which it has ended. */
const refusal = async (answer) =>
  answer.headers.has('X-Server') ? (await answer.text()).trim() : gone();

/* Another viewer has the address. Of the same run it is this one, started again, and the page
 * begins anew; else, or if there is something that was not saved, the page stays as it is and asks
 * for nothing any more. */
async function leave() {
  if (left) return;
  left = true;
  if (keyframes.length === 0 && !facts.training) {
    const next = await fetch('facts').then((a) => a.json()).catch(() => ({}));
    if (next.run === facts.run && !next.training) {
      location.reload();
      return;
    }
  }
  for (const id of ['pause', 'checkpoint', 'stop']) $(id).disabled = true;
  if (facts.training) $('training-state').textContent = 'ended';
  say(`This page is of ${facts.run}, whose viewer has ended; another one has its address. ` +
    'Reload the page to see what that shows.', true);
}

const underWay = () => training !== null && !ended && training.state !== 'paused';

/* The sharp picture is there, and one whose edges are better can be had. */
const isRough = () => last.full && last.finer > 0 && !underWay();

/* What the next picture may take; 0 = as long as the sharp one needs. */
function nextMs(refining) {
  if (!refining) return MOVING_MS;
  if (isRough()) return 0;
  return last.ms === MOVING_MS ? BETTER_MS : underWay() ? WHOLE_MS : 0;
}

const isNew = () => !(training && training.step > last.step) && !isRough() &&
  (last.full || (underWay() && last.ms === WHOLE_MS));

/* One request at a time: small pictures while the camera moves, then a better one, then the sharp
 * one and then its edges, which a motion cancels; of a training, again when it has gone on. */
async function pump() {
  if (busy || !facts) return;
  busy = true;
  while (!left) {
    await seen();
    const now = version, refining = last !== null && last.version === now;
    if (refining && isNew()) break;
    const rest = STILL_MS - (performance.now() - moved);
    if (refining && rest > 0) {
      await new Promise((done) => setTimeout(done, rest));
      continue;
    }
    try {
      await fetchPicture(now, nextMs(refining), refining);
    } catch (error) {
      if (error.name === 'AbortError') continue;
      if (left) break;
      say(error.refused || gone());
      await new Promise((done) => setTimeout(done, 1500));
    }
  }
  busy = false;
}

async function fetchPicture(now, ms, refining) {
  const f = frame(), began = performance.now(), step = training ? training.step : 0;
  const show = $('show').value;
  const box = at >= 0 ? inset(f) : {x: 0, y: 0, width: f.width, height: f.height};
  abort = new AbortController();
  abort.refining = refining;
  const edges = Number(refining && isRough());
  const answer = await ask('picture', {...cameraQuery(f), ms, edges, ...looks()}, viewer,
    abort.signal);
  if (answer.status === 409) return;
  if (!answer.ok) throw Object.assign(new Error(), {refused: await refusal(answer)});
  const bitmap = await createImageBitmap(await answer.blob());
  const [width, height, took, near, far, finer] =
    answer.headers.get('X-Picture').split(' ').map(Number);
  if (last) last.bitmap.close();
  last = {bitmap, version: now, ms, width, height, took, near, far, finer, at, frame: f, box, step,
    show, full: width >= box.width, whole: performance.now() - began};
  draw();
}

function draw() {
  if (!last) return;
  const f = last.frame, b = last.box;
  if (picture.width !== f.width || picture.height !== f.height) {
    picture.width = f.width;
    picture.height = f.height;
  }
  pen.globalAlpha = 1;
  pen.fillStyle = last.at >= 0 ? '#808080' : '#000';
  pen.fillRect(0, 0, f.width, f.height);
  pen.drawImage(last.bitmap, b.x, b.y, b.width, b.height);
  if (last.at >= 0 && last.at === at && photo) {
    if ($('difference').checked) {
      drawDifference(b);
    } else if (Number($('blend').value) > 0) {
      pen.globalAlpha = Number($('blend').value);
      pen.drawImage(photo, b.x, b.y, b.width, b.height);
    }
  }
  const of = last.full ? '' : ` of ${b.width}×${b.height}`;
  const depth = last.far > 0 && last.show === 'depth' ?
    ` · depth ${last.near.toFixed(digits())} to ${last.far.toFixed(digits())}` : '';
  $('numbers').textContent = `${last.width}×${last.height}${of} · ${last.took.toFixed(0)} ms ` +
    `render · ${last.whole.toFixed(0)} ms in all${depth}`;
  showLegend();
}

/* What the colours of leaves mean. */
function showLegend() {
  const part = (colour, text) => {
    const item = document.createElement('span'), swatch = document.createElement('i');
    swatch.style.background = colour;
    item.append(swatch, text);
    return item;
  };
  const legend = $('legend'), key = `${last.show} ${last.near} ${last.far}`;
  legend.hidden = last.show !== 'level' && last.show !== 'error';
  if (legend.dataset.key === key) return;
  legend.dataset.key = key;
  const n = facts.errors.length - 1;
  legend.replaceChildren(...(last.show === 'level' ? facts.levels.map((c, i) => part(c, `${i}`)) :
    last.far > 0 ? facts.errors.map((c, i) => part(c,
      (last.near * (last.far / last.near) ** (i / n)).toExponential(1))) :
      ['no error of a leaf has been measured']));
}

/* |render - photo| times four, as in the pictures of an evaluation. */
function drawDifference(b) {
  pen.globalCompositeOperation = 'difference';
  pen.drawImage(photo, b.x, b.y, b.width, b.height);
  pen.globalCompositeOperation = 'lighter';
  for (let k = 0; k < 2; k++)
    pen.drawImage(picture, b.x, b.y, b.width, b.height, b.x, b.y, b.width, b.height);
  pen.globalCompositeOperation = 'source-over';
}

async function savePicture() {
  say('Rendering…', true);
  try {
    const answer = await ask('picture', {...cameraQuery(frame()), ...looks(), edges: 1,
      format: 'png'}, viewer + '-s');
    if (!answer.ok) throw new Error(await refusal(answer));
    download(await answer.blob(), `${facts.run.split('/').filter(Boolean).pop()}.png`);
    say('The screenshot is saved.');
  } catch (error) {
    say(`No screenshot: ${error.message}`);
  }
}

function download(blob, name) {
  const link = document.createElement('a');
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

/* ---- motion ---- */

function orbit(dx, dy) {
  const centre = pivot(camera), up = facts.up;
  const tilt = Math.acos(clamp(dot(camera.r[2], up), -1, 1)); /* from up; stay off the poles */
  const pitch = clamp(dy, tilt - (Math.PI - 0.03), Math.max(tilt - 0.03, 0));
  camera.r = camera.r.map((v) => turn(v, up, -dx));
  const axis = camera.r[0];
  camera.r = camera.r.map((v) => turn(v, axis, tilt < 0.03 || tilt > Math.PI - 0.03 ?
    dy : pitch));
  straighten(camera);
  camera.p = add(centre, camera.r[2], -camera.distance);
  touch();
}

/* Turns where it stands: what is under the pointer follows it. */
function lookAround(dx, dy) { /* in shares of the picture's shorter side */
  const k = camera.fov * Math.PI / 180, up = facts.up;
  const tilt = Math.acos(clamp(dot(camera.r[2], up), -1, 1));
  const pitch = clamp(k * dy, tilt - (Math.PI - 0.03), Math.max(tilt - 0.03, 0));
  camera.r = camera.r.map((v) => turn(v, up, k * dx));
  const axis = camera.r[0];
  camera.r = camera.r.map((v) => turn(v, axis, pitch));
  straighten(camera);
  touch();
}

/* Are the photos taken from inside, in all directions, as of a room, or panoramas? Those of an
 * object look at it, those of a wall the same way. */
function areInside(cameras) {
  const poses = cameras.map((c) => fromPose(c.pose)), n = poses.length;
  if (n > 0 && cameras.every((c) => c.around)) return true;
  if (n < 3) return false;
  const middle = scale(poses.reduce((sum, c) => add(sum, c.p), [0, 0, 0]), 1 / n);
  const mean = scale(poses.reduce((sum, c) => add(sum, c.r[2]), [0, 0, 0]), 1 / n);
  const inwards = poses.reduce((sum, c) => sum + dot(c.r[2], unit(add(middle, c.p, -1))), 0) / n;
  return size(mean) < 0.6 && inwards < 0.4;
}

const isInside = () => $('inside').checked;

function shift(right, down) { /* in shares of the picture's shorter side */
  const s = 2 * camera.distance * Math.tan(camera.fov * Math.PI / 360);
  camera.p = add(add(camera.p, camera.r[0], -right * s), camera.r[1], -down * s);
  touch();
}

function zoom(factor) {
  if (isInside()) { /* there is nothing to come nearer to: ahead or back */
    camera.p = add(camera.p, camera.r[2], -0.5 * facts.distance * Math.log(factor));
    touch();
    return;
  }
  const centre = pivot(camera);
  camera.distance = clamp(camera.distance * factor, 1e-4 * facts.distance, 1e3 * facts.distance);
  camera.p = add(centre, camera.r[2], -camera.distance);
  touch();
}

function roll(angle) {
  camera.r = camera.r.map((v) => turn(v, camera.r[2], angle));
  straighten(camera);
  touch();
}

function level() {
  const right = cross(camera.r[2], facts.up);
  if (size(right) < 1e-3) return;
  camera.r[0] = unit(right);
  straighten(camera);
  tell('The horizon is straight.');
  touch();
}

/* Takes the camera there in a short while; keepAt: there it is the scene's camera `at`. */
function fly(to, keepAt = -1) {
  const from = copy(camera), began = performance.now();
  const took = matchMedia('(prefers-reduced-motion: reduce)').matches ? 0 : 350;
  const a = toQuaternion(from.r), b = toQuaternion(to.r);
  const sign = a.reduce((sum, v, i) => sum + v * b[i], 0) < 0 ? -1 : 1;
  stopMotion();
  goal = keepAt;
  if (at >= 0) leaveCamera();
  const step = () => {
    const t = took > 0 ? clamp((performance.now() - began) / took, 0, 1) : 1;
    const s = t * t * (3 - 2 * t);
    if (t < 1) {
      camera.p = add(scale(from.p, 1 - s), to.p, s);
      camera.r = fromQuaternion(a.map((v, i) => (1 - s) * v + s * sign * b[i]));
      camera.fov = (1 - s) * from.fov + s * to.fov;
      camera.distance = (1 - s) * from.distance + s * to.distance;
      flight = requestAnimationFrame(step);
      touch(false, true);
      return;
    }
    camera = copy(to);
    if (keepAt >= 0) enterCamera(keepAt);
    touch(keepAt >= 0, true);
  };
  step();
}

/* The user takes the camera. */
function stopMotion() {
  stopPlaying();
  cancelAnimationFrame(flight);
  goal = -1;
}

/* Digits behind the point of a length, for a thousandth of the cube. */
function digits() {
  return Math.min(Math.max(0, 3 - Math.floor(Math.log10(facts.half))), 12);
}

/* Tells where a point is, how far from the one before, and if it is seen through. */
let placed = null;

function tellPlace(point, opacity) {
  const numbers = point.map((x) => x.toFixed(digits())).join(', ');

  $('place').textContent = `x, y, z: ${numbers}` + (placed ?
    `; ${size(add(point, placed, -1)).toFixed(digits())} from the point before` : '') +
    (opacity < 0.9 ? `; opacity ${opacity.toFixed(2)}: the place is a guess` : '');
  $('place').hidden = false;
  placed = point;
}

/* Turns about what is seen at a position of the window. */
async function focus(x, y) {
  const f = frame();
  const query = cameraQuery(f);
  let px = x * f.factor, py = y * f.factor;
  if (at >= 0) {
    const box = inset(f);
    px -= box.x;
    py -= box.y;
    if (px < 0 || py < 0 || px >= box.width || py >= box.height) return;
  }
  try {
    const answer = await ask('point', {...query, x: px, y: py}, viewer);
    if (!answer.ok) return;
    const found = await answer.json();
    if (found.opacity < 0.3) {
      say('Nothing is there.');
      return;
    }
    tellPlace(found.point, found.opacity);
    const to = copy(camera), forward = add(found.point, camera.p, -1);
    to.r[2] = unit(forward);
    straighten(to);
    to.distance = size(forward);
    fly(to);
  } catch (error) {
    say('The viewer does not answer.');
  }
}

/* ---- mouse and touch ---- */

const fingers = new Map();
let travelled = 0, tapped = 0;
let together = 0; /* the most fingers at once since the first came down */

picture.addEventListener('pointerdown', (event) => {
  picture.setPointerCapture(event.pointerId);
  fingers.set(event.pointerId, {x: event.offsetX, y: event.offsetY});
  if (fingers.size === 1) travelled = together = 0;
  together = Math.max(together, fingers.size);
  stopMotion();
});

picture.addEventListener('pointermove', (event) => {
  const was = fingers.get(event.pointerId);
  if (!was || !camera) return;
  const dx = event.offsetX - was.x, dy = event.offsetY - was.y;
  const shorter = Math.min(picture.clientWidth, picture.clientHeight);
  travelled += Math.abs(dx) + Math.abs(dy);
  if (travelled < 4 || (dx === 0 && dy === 0)) return;
  if (fingers.size === 2) {
    const other = [...fingers].find(([id]) => id !== event.pointerId)[1];
    const before = Math.hypot(was.x - other.x, was.y - other.y);
    const after = Math.hypot(event.offsetX - other.x, event.offsetY - other.y);
    if (before > 0 && after > 0) zoom(before / after);
    shift(dx / 2 / shorter, dy / 2 / shorter);
  } else if (fingers.size > 2) {
    shift(dx / fingers.size / shorter, dy / fingers.size / shorter);
  } else if (event.buttons & 6 || event.shiftKey) {
    shift(dx / shorter, dy / shorter);
  } else if (isInside()) {
    lookAround(dx / shorter, dy / shorter);
  } else {
    orbit(3 * dx / shorter, -3 * dy / shorter);
  }
  fingers.set(event.pointerId, {x: event.offsetX, y: event.offsetY});
});

function released(event) {
  fingers.delete(event.pointerId);
  if (event.type !== 'pointerup' || travelled >= 4 || together > 1 || !camera ||
      event.button !== 0)
    return;
  if (event.timeStamp - tapped < 350) { /* touch has no reliable dblclick */
    tapped = 0;
    focus(event.offsetX, event.offsetY);
    return;
  }
  tapped = event.timeStamp;
  const hit = cameraAt(event.offsetX, event.offsetY);
  if (hit >= 0) jump(hit);
}
picture.addEventListener('pointerup', released);
picture.addEventListener('pointercancel', released);
picture.addEventListener('contextmenu', (event) => event.preventDefault());
picture.addEventListener('wheel', (event) => {
  event.preventDefault();
  if (camera) zoom(Math.exp(clamp(event.deltaY * (event.deltaMode ? 20 : 1), -300, 300) / 600));
}, {passive: false});

/* ---- keys ---- */

const held = new Set();
let flying = 0;
const HELD = 'wasdrfqe';

const keys = {
  h: () => { fly(home); tell('Back at the start.'); },
  l: level, x: savePicture, m: () => openPanel(),
  c: () => toggle('frusta'), n: () => jumpBy(1), p: () => jumpBy(-1), k: addKey,
  g: () => focus(picture.clientWidth / 2, picture.clientHeight / 2),
  b: () => toggleBlend(), v: () => { toggle('difference'); draw(); }, ' ': play,
  '1': () => show('colour'), '2': () => show('depth'),
  '3': () => show('opacity'), '4': () => show('level'), '5': () => show('error'),
  i: () => {
    $('inside').checked = !isInside();
    say(isInside() ? 'Drags and arrows look around from where you stand.' :
      'Drags and arrows turn about the middle.');
  },
  o: () => { toggle('crop'); changeCrop(); },
  '+': () => zoom(0.9), '=': () => zoom(0.9), '-': () => zoom(1 / 0.9),
  '?': () => { openPanel(true); $('help').open = true; $('help').scrollIntoView(); },
};
const arrows = {ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1]};

function show(what) {
  $('show').value = what;
  tell(`Shows ${$('show').selectedOptions[0].textContent}.`);
  touch(true);
}

function toggle(id) {
  $(id).checked = !$(id).checked;
  tell(`${$(id).labels[0].textContent.trim()}: ${$(id).checked ? 'on' : 'off'}`);
  drawLines();
}

/* A key is the picture's unless a control that uses it has the focus. */
function forControl(event) {
  const on = document.activeElement;
  if (!on || on === picture || on === document.body) return false;
  if (/^(INPUT|SELECT|TEXTAREA)$/.test(on.tagName)) return on.type !== 'checkbox' ||
    event.key === ' ';
  return event.key === ' ' || event.key === 'Enter' ||
    (event.key in arrows && $('panel').contains(on));
}

addEventListener('keydown', (event) => {
  if (event.key === 'Escape') picture.focus();
  if (!camera || event.ctrlKey || event.metaKey || event.altKey || forControl(event)) return;
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  if (key.length === 1 && !$('letters').checked && document.activeElement !== picture) return;
  if (key in arrows) {
    const [x, y] = arrows[key];
    if (event.shiftKey) shift(-0.03 * x, -0.03 * y);
    else if (isInside()) lookAround(-0.06 * x, -0.06 * y);
    else orbit(0.06 * x, 0.06 * -y);
  } else if (HELD.includes(key)) {
    held.add(key);
    if (!flying) {
      flying = performance.now();
      requestAnimationFrame(flyStep);
    }
  } else if (key in keys) {
    keys[key]();
  } else {
    return;
  }
  event.preventDefault();
});
let fast = false;
addEventListener('keyup', (event) => held.delete(event.key.toLowerCase()));
addEventListener('blur', () => held.clear());
for (const type of ['keydown', 'keyup']) addEventListener(type, (e) => { fast = e.shiftKey; });

function flyStep(now) {
  if (held.size === 0) {
    flying = 0;
    return;
  }
  const seconds = clamp((now - flying) / 1000, 0, 0.1), sign = (a, b) => held.has(a) - held.has(b);
  const step = seconds * facts.distance * (fast ? 2 : 0.5);
  flying = now;
  camera.p = add(camera.p, camera.r[2], step * sign('w', 's'));
  camera.p = add(camera.p, camera.r[0], step * sign('d', 'a'));
  camera.p = add(camera.p, camera.r[1], step * sign('f', 'r'));
  if (sign('e', 'q')) roll(seconds * sign('e', 'q'));
  touch();
  requestAnimationFrame(flyStep);
}

/* ---- the scene's cameras ---- */

function listCameras() {
  const pictures = new IntersectionObserver((entries) => {
    for (const entry of entries) {
      if (!entry.isIntersecting) continue;
      pictures.unobserve(entry.target);
      entry.target.src =
        `photo?server=${server}&view=${entry.target.dataset.view}&side=128`;
    }
  });
  facts.cameras.forEach((c, i) => {
    const item = document.createElement('li'), button = document.createElement('button');
    const image = document.createElement('img'), split = document.createElement('small');
    image.alt = '';
    image.dataset.view = i;
    split.textContent = c.split;
    button.append(image, c.name, split);
    button.addEventListener('click', () => jump(i));
    item.append(button);
    $('cameras').append(item);
    pictures.observe(image);
  });
  $('camera-count').textContent = `(${facts.cameras.length})`;
  $('cameras-part').hidden = facts.cameras.length === 0;
}

function jump(i) {
  const c = facts.cameras[i], to = {...fromPose(c.pose), fov: 50, distance: 1};
  const forward = dot(add(facts.target, to.p, -1), to.r[2]);
  to.fov = 360 / Math.PI * Math.atan(Math.min(c.width, c.height) / 2 / c.focal);
  to.distance = forward > 0.05 * facts.distance ? forward : facts.distance;
  straighten(to);
  fly(to, i);
}

function jumpBy(by) {
  const n = facts.cameras.length, from = at < 0 ? goal : at;
  if (n > 0) jump(from < 0 ? (by > 0 ? 0 : n - 1) : (from + by + n) % n);
}

/* The picture's name: the run, and at which camera it is. */
function namePicture() {
  const where = at < 0 ? '' : ` from the camera of photo ${facts.cameras[at].name}`;
  picture.setAttribute('aria-label', `The scene ${facts.run}${where}`);
}

function enterCamera(i) {
  at = i;
  photo = null;
  $('beside').disabled = false;
  $('camera-name').textContent = facts.cameras[i].name;
  tell(`Camera ${facts.cameras[i].name}, ${facts.cameras[i].split}`);
  namePicture();
  fetchPhoto();
  mark(i);
}

/* Where the photo is transparent, it has the page's background, as the picture. */
function fetchPhoto() {
  const image = new Image(), colour = background().join(',');
  coming = image;
  image.onload = () => {
    if (coming !== image) return;
    coming = null;
    photo = image;
    draw();
    if (background().join(',') !== colour) fetchPhoto();
  };
  image.onerror = () => {
    if (coming !== image) return;
    coming = null;
    $('camera-name').textContent = `${facts.cameras[at].name} (no photo here)`;
  };
  image.src = `photo?server=${server}&view=${at}&side=1600&background=${colour}`;
}

function refreshPhoto() {
  if (at >= 0 && !coming) fetchPhoto();
}

function leaveCamera() {
  mark(-1);
  at = -1;
  photo = coming = null;
  $('beside').disabled = true;
  $('camera-name').textContent = NO_CAMERA;
  namePicture();
}

function mark(i) {
  for (const old of document.querySelectorAll('#cameras [aria-current]'))
    old.removeAttribute('aria-current');
  if (i < 0) return;
  const button = $('cameras').children[i].firstChild;
  button.setAttribute('aria-current', 'true');
  button.scrollIntoView({block: 'nearest'});
}

function toggleBlend() {
  $('blend').value = Number($('blend').value) > 0.5 ? 0 : 1;
  draw();
}

/* ---- lines over the picture ---- */

/* Window position of a point, or null behind the camera. */
function project(point, f) {
  const v = add(point, camera.p, -1), z = dot(v, camera.r[2]);
  if (z < 1e-3 * facts.distance) return null;
  return [(f.focal * dot(v, camera.r[0]) / z + f.width / 2) / f.factor,
    (f.focal * dot(v, camera.r[1]) / z + f.height / 2) / f.factor];
}

function line(points, colour, width = 1) {
  if (points.some((p) => !p)) return;
  lines.strokeStyle = colour;
  lines.lineWidth = width;
  lines.beginPath();
  points.forEach((p, i) => i ? lines.lineTo(p[0], p[1]) : lines.moveTo(p[0], p[1]));
  lines.stroke();
}

const COLOURS = {train: '#2f8fff', val: '#35b26f', test: '#ff9a2f'};

function drawFrustum(pose, aspect, half, split, f, length) {
  const c = fromPose(pose), apex = project(c.p, f);
  const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([x, y]) => project(add(add(add(c.p,
    c.r[2], length), c.r[0], x * half * aspect * length), c.r[1], y * half * length), f));
  const colour = COLOURS[split];
  line([...corners, corners[0]], colour);
  for (const corner of corners) line([apex, corner], colour);
  if (split !== 'train') line([corners[0], corners[2]], colour);
  if (split === 'test') line([corners[1], corners[3]], colour);
}

function drawLines() {
  const ratio = devicePixelRatio || 1, box = overlay.getBoundingClientRect();
  const width = Math.round(box.width * ratio), height = Math.round(box.height * ratio);
  if (!camera) return;
  if (overlay.width !== width || overlay.height !== height) {
    overlay.width = width;
    overlay.height = height;
  }
  lines.setTransform(ratio, 0, 0, ratio, 0, 0);
  lines.clearRect(0, 0, box.width, box.height);
  const f = frame();
  if ($('frusta').checked && at < 0) {
    facts.cameras.forEach((c) => drawFrustum(c.pose, c.width / c.height, c.height / 2 / c.focal,
      c.split, f, 0.08 * facts.distance));
  }
  if (at < 0 && $('crop').checked && (isCropped() || isTurned()) && $('crop-part').open)
    drawCrop(f);
  if (keyframes.length > 1 && at < 0 && !playing) {
    const count = 24 * keyframes.length, trail = [];
    for (let i = 0; i <= count; i++) trail.push(project(along(i / count).p, f));
    for (let i = 0; i < count; i++) line([trail[i], trail[i + 1]], '#e0358b', 2);
  }
}

/* The camera that stands at a position of the window, -1 without. */
function cameraAt(x, y) {
  if (!$('frusta').checked || at >= 0) return -1;
  const f = frame();
  let best = -1, nearest = 14;
  facts.cameras.forEach((c, i) => {
    const p = project(fromPose(c.pose).p, f), d = p ? Math.hypot(p[0] - x, p[1] - y) : 1e9;
    if (d < nearest) [best, nearest] = [i, d];
  });
  return best;
}

/* ---- the panel, the start ---- */

function openPanel(open = document.body.classList.contains('closed')) {
  if (!open && $('panel').contains(document.activeElement)) $('menu').focus();
  document.body.classList.toggle('closed', !open);
  $('menu').setAttribute('aria-expanded', String(open));
}

async function begin() {
  const answer = await fetch('facts');
  if (!answer.ok) throw new Error(await refusal(answer));
  facts = await answer.json();
  server = answer.headers.get('X-Server');
  document.title = `${facts.run} – cl-nascent`;
  $('title').textContent = `${facts.run}, step ${facts.step.toLocaleString('en')}`;
  namePicture();
  setBackground(facts.background);
  home = {...fromPose(facts.start), distance: 1, fov: 360 / Math.PI *
    Math.atan(Math.min(facts.width, facts.height) / 2 / facts.focal)};
  home.distance = size(add(facts.target, home.p, -1));
  camera = copy(home);
  $('inside').checked = areInside(facts.cameras);
  makeCrop();
  listCameras();
  takePath();
  $('training').hidden = !facts.training;
  if (facts.training) {
    $('cameras-part').open = false;
    watch();
  } else {
    lookForNewer();
  }
  touch();
}

const on = (id, type, does) => $(id).addEventListener(type, does);
on('menu', 'click', () => openPanel());
on('show', 'change', () => touch(true));
on('background', 'input', () => {
  refreshPhoto();
  touch(true);
});
on('size', 'change', () => touch(true));
on('fov', 'input', () => { camera.fov = Number($('fov').value); touch(); });
on('home', 'click', () => fly(home));
on('level', 'click', level);
on('save-picture', 'click', savePicture);
on('frusta', 'change', drawLines);
on('blend', 'input', draw);
on('difference', 'change', draw);
on('add-key', 'click', addKey);
on('play', 'click', play);
on('cycle', 'change', drawLines);
on('make-film', 'click', makeFilm);
on('crop', 'change', changeCrop);
on('crop-reset', 'click', resetCrop);
on('crop-part', 'toggle', drawLines);
on('pause', 'click', () => order(training && training.state === 'paused' ? 'continue' : 'pause'));
on('checkpoint', 'click', () => order('save'));
on('stop', 'click', stopTraining);
on('stop', 'blur', keepTraining);
on('save-path', 'click', savePath);
on('save-transforms', 'click', saveTransforms);
on('open-path', 'change', () => {
  openFiles([...$('open-path').files]);
  $('open-path').value = '';
});
new ResizeObserver(() => { if (camera) touch(true); }).observe($('stage'));
/* What the address asks for behind #, as on a screen without a keyboard: panel=0 leaves the panel
 * and its button out, size=2 is the picture's, idle=60 goes back to the start when nobody has moved
 * for so many seconds. */
const wish = new URLSearchParams(location.hash.slice(1));
document.body.classList.toggle('alone', wish.get('panel') === '0');
openPanel(innerWidth > 760 && wish.get('panel') !== '0');
if ([...$('size').options].some((o) => o.value === wish.get('size')))
  $('size').value = wish.get('size');
if (wish.get('idle') > 0)
  setInterval(() => {
    const rest = performance.now() - moved > 1000 * wish.get('idle');
    if (camera && rest && !playing && JSON.stringify(camera) !== JSON.stringify(home)) fly(home);
  }, 1000);

/* Until the viewer answers. */
async function start() {
  try {
    await begin();
    say('');
  } catch (error) {
    say(error instanceof TypeError ? gone() : error.message, true);
    if (!camera) setTimeout(start, 1500);
  }
}
start();
