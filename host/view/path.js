/* The viewer's camera path: views that it goes through, playing it, its files, and its film, which
 * the server makes of the frames that are asked for here. Vectors, cameras and requests are
 * page.js's. */
'use strict';

/* ---- a camera path ---- */

/* Catmull and Rom's spline through four values. */
const spline = (a, b, c, d, t) => b + 0.5 * t * (c - a + t * (2 * a - 5 * b + 4 * c - d +
  t * (3 * (b - c) + d - a)));

/* Sine and cosine of a camera's roll against a level one of its direction, times the sine of that
 * direction's angle with up. */
function rollOf(r) {
  const right = cross(r[2], facts.up);
  return [dot(r[0], cross(r[2], right)), dot(r[0], right)];
}

/* Turned about its direction so that its roll is the keys': between directions that are far apart,
 * the quaternions' straight way rolls level cameras. As in render/path.c. */
function keepRoll(r, roll) {
  const now = rollOf(r);
  const weight = Math.min(1, 2 * Math.min(Math.hypot(...now), Math.hypot(...roll)));
  if (!(weight > 1e-6)) return r;
  const angle = (Math.atan2(...roll) - Math.atan2(...now)) / (2 * Math.PI);
  return r.map((v) => turn(v, r[2], weight * 2 * Math.PI * (angle - Math.round(angle))));
}

/* The path's camera at a share 0..1 of its time. */
function along(share) {
  const n = keyframes.length, closed = $('cycle').checked, spans = closed ? n : n - 1;
  const time = clamp(share * spans, 0, spans), i = Math.min(Math.floor(time), spans - 1);
  const key = (k) => keyframes[closed ? (k + n) % n : clamp(k, 0, n - 1)];
  const four = [-1, 0, 1, 2].map((k) => key(i + k)), t = time - i;
  const turns = four.map((k) => toQuaternion(k.r));
  for (let k = 1; k < 4; k++) /* the same turn as q and -q: the near one */
    if (turns[k].reduce((sum, v, a) => sum + v * turns[k - 1][a], 0) < 0)
      turns[k] = turns[k].map((v) => -v);
  const mix = (values) => values[0].map((_, a) => spline(...values.map((v) => v[a]), t));
  return {p: mix(four.map((k) => k.p)),
    r: keepRoll(fromQuaternion(mix(turns)), mix(four.map((k) => rollOf(k.r)))),
    fov: clamp(mix(four.map((k) => [k.fov]))[0], 1, 170),
    distance: Math.max(mix(four.map((k) => [k.distance]))[0], 1e-4 * facts.distance)};
}

function addKey() {
  keyframes.push(copy(camera));
  tell(`View ${keyframes.length} is added to the path.`);
  listKeys();
}

/* The path has changed: it plays no more, and its buttons are made anew. row, column: the one that
 * has the focus then, if one of them has it for the keyboard. */
function listKeys(row, column) {
  const focused = $('keys-list').querySelector(':focus-visible') !== null;
  stopPlaying();
  $('keys-list').replaceChildren(...keyframes.map((key, i) => {
    const item = document.createElement('li');
    const button = (text, label, does) => {
      const b = document.createElement('button');
      b.textContent = text;
      b.setAttribute('aria-label', label);
      b.addEventListener('click', does);
      item.append(b);
    };
    button(`View ${i + 1}`, `Go to view ${i + 1}`, () => fly(key));
    button('↑', `View ${i + 1} earlier`, () => {
      if (i > 0) [keyframes[i - 1], keyframes[i]] = [keyframes[i], keyframes[i - 1]];
      listKeys(Math.max(0, i - 1), 1);
    });
    button('Set', `Set view ${i + 1} to this one`, () => {
      keyframes[i] = copy(camera);
      listKeys(i, 2);
    });
    button('×', `Remove view ${i + 1}`, () => {
      keyframes.splice(i, 1);
      listKeys(Math.min(i, keyframes.length - 1), 3);
    });
    return item;
  }));
  if (focused) ($('keys-list').children[row]?.children[column] ?? $('add-key')).focus();
  $('key-count').textContent = keyframes.length ? `(${keyframes.length})` : '';
  drawLines();
}

const seconds = () => clamp(Number($('seconds').value) || 5, 0.1, 3600);
/* 23.976, as files of other programs have it, stays: films take it for 24000/1001. */
const perSecond = () => clamp(Math.round(1000 * Number($('fps').value)) / 1000 || 24, 1, 120);

function play() {
  if (playing) {
    stopPlaying();
    return;
  }
  if (keyframes.length < 2) {
    say('Add two views or more to the path (K).');
    return;
  }
  stopMotion();
  const began = performance.now();
  const step = (now) => {
    const share = (now - began) / 1000 / seconds();
    if (share >= 1 && !$('cycle').checked) {
      camera = along(1);
      touch();
      return;
    }
    camera = along(share % 1);
    touch(false, true);
    playing = requestAnimationFrame(step);
  };
  playing = requestAnimationFrame(step);
  $('play').textContent = 'Stop';
}

function stopPlaying() {
  if (!playing) return;
  cancelAnimationFrame(playing);
  playing = 0;
  $('play').textContent = 'Play';
  drawLines();
}

/* What the page has besides the model lasts when it is loaded again: the camera and the path. */
const sceneName = () => JSON.stringify([facts.run, facts.centre, facts.half, facts.start,
  facts.cameras.map((c) => c.name)]);

function keepPath() {
  if (!camera) return;
  try {
    sessionStorage.setItem('path', JSON.stringify({scene: sceneName(), camera, keyframes,
      seconds: seconds(), fps: perSecond(), cycle: $('cycle').checked}));
  } catch (error) {
    /* a browser that keeps nothing */
  }
}

function takePath() {
  try {
    const kept = JSON.parse(sessionStorage.getItem('path'));
    if (!kept || kept.scene !== sceneName()) return;
    camera = copy(kept.camera);
    keyframes = kept.keyframes.map(copy);
    $('seconds').value = kept.seconds;
    $('fps').value = kept.fps;
    $('cycle').checked = kept.cycle;
    listKeys();
  } catch (error) {
    /* of another version: begin as usual */
  }
}

/* Says what a file of cameras does not have of what the page shows. */
function tellLost(name) {
  const lost = [], options = [], numbers = (list) => list.map((v) => Number(v.toPrecision(5)));
  if (isCropped()) {
    lost.push('the crop box');
    options.push(isTurned() ? '--poses camera_path.json' : `--crop=${numbers(cropSides())}`);
  }
  if (background().some((v, i) => Math.abs(v - facts.background[i]) > 0.003)) {
    lost.push('the background');
    options.push(`--background ${numbers(background())}`);
  }
  if (lost.length)
    say(`${name} has no place for ${lost.join(' and ')}: give render ${options.join(' ')}.`);
}

/* nerfstudio's: camera to world 4x4, row-major, OpenGL's axes (right, up, back); vertical fov. */
function toNerfstudio(c) {
  const m = toPose(c);
  return [...[0, 1, 2].flatMap((a) => [m[4 * a], -m[4 * a + 1], -m[4 * a + 2], m[4 * a + 3]]),
    0, 0, 0, 1];
}

/* The other way; older files have the matrix as text, and by columns. */
function fromNerfstudio(given) {
  let m = typeof given === 'string' ? JSON.parse(given) : given.flat();
  if (m.length !== 16 || !m.every(Number.isFinite)) throw new Error('a matrix is not 4 x 4');
  if (m[3] === 0 && m[7] === 0 && m[11] === 0 && (m[12] || m[13] || m[14]))
    m = m.map((_, i) => m[4 * (i % 4) + (i >> 2)]);
  return fromPose([0, 1, 2].flatMap((a) => [m[4 * a], -m[4 * a + 1], -m[4 * a + 2],
    m[4 * a + 3]]));
}

const rows4 = (m) => [0, 4, 8, 12].map((k) => m.slice(k, k + 4));

/* The path's cameras frame by frame; null, and says it, if there is none or there are more than
 * `most`: without a number, those that `render --poses` takes. */
function framesOfPath(most = 100000) {
  if (keyframes.length < 2) {
    play(); /* says it */
    return null;
  }
  const count = Math.max(2, Math.round(seconds() * perSecond()));
  if (count > most) {
    say(`The path has ${count.toLocaleString('en')} frames, more than ` +
      `${most.toLocaleString('en')}: choose fewer seconds or frames a second.`);
    return null;
  }
  const parts = $('cycle').checked ? count : count - 1;
  return Array.from({length: count}, (_, i) => along(i / parts));
}

function saveText(document, name) {
  download(new Blob([JSON.stringify(document, null, 1)], {type: 'application/json'}), name);
}

/* In nerfstudio's words; null without a box. */
function cropOfPath() {
  if (!isCropped()) return null;
  const sides = cropSides(), [r, g, b] = background().map((v) => Math.round(255 * v));
  return {crop_center: [0, 1, 2].map((a) => (sides[a] + sides[a + 3]) / 2),
    crop_scale: [0, 1, 2].map((a) => sides[a + 3] - sides[a]),
    crop_rot: cropTurn.map((v) => v * Math.PI / 180),
    crop_bg_color: {r, g, b}};
}

/* Three numbers of a file's crop; `otherwise` if it has none under the key. */
function threeOf(crop, key, otherwise) {
  const values = crop[key] ?? otherwise;
  if (!Array.isArray(values) || values.length !== 3 || !values.every(Number.isFinite))
    throw new Error(`its ${key} is not 3 numbers`);
  return values;
}

/* The box of a file and what is around it; null without a box. What `render --poses` refuses is an
 * error. */
function readCrop(crop) {
  if (typeof crop !== 'object' || !crop) return null;
  const middle = threeOf(crop, 'crop_center'), lengths = threeOf(crop, 'crop_scale');
  const colour = crop.crop_bg_color ?? {}, around = ['r', 'g', 'b'].map((c) => colour[c] ?? 0);
  if (!lengths.every((v) => v > 0))
    throw new Error('its crop_scale is not the sides of a box, above 0');
  if (typeof colour !== 'object' || Array.isArray(colour) || !around.every(Number.isFinite))
    throw new Error('its crop_bg_color is not r, g and b');
  return {background: around.map((v) => v / 255),
    sides: [-0.5, 0.5].flatMap((half) => middle.map((v, a) => v + half * lengths[a])),
    degrees: threeOf(crop, 'crop_rot', [0, 0, 0]).map((v) => v * 180 / Math.PI)};
}

/* Takes over such a box, as `render --poses` does; without one, the page's is off. */
function openCrop(box) {
  if (!box) {
    $('crop').checked = false;
    changeCrop();
    return;
  }
  setBackground(box.background);
  setCrop(box.sides, box.degrees);
}

function savePath() {
  const path = framesOfPath(), f = frame(), aspect = f.width / f.height;
  if (!path) return;
  const vertical = (c) => 360 / Math.PI * Math.atan(Math.tan(c.fov * Math.PI / 360) *
    f.height / Math.min(f.width, f.height));
  saveText({
    camera_type: 'perspective', render_height: f.height, render_width: f.width,
    fps: perSecond(), seconds: seconds(), is_cycle: $('cycle').checked, smoothness_value: 0,
    keyframes: keyframes.map((c) => ({matrix: toNerfstudio(c), fov: vertical(c), aspect})),
    camera_path: path.map((c) => ({camera_to_world: toNerfstudio(c), fov: vertical(c), aspect})),
    crop: cropOfPath(), poses_in: 'scene', // not in nerfstudio's frame
  }, 'camera_path.json');
  if (!isCropped()) tellLost('camera_path.json without a crop box');
}

/* As `render --poses` and other programs read it; without the views that the path goes through. */
function saveTransforms() {
  const path = framesOfPath(), f = frame();
  if (!path) return;
  const focal = (c) => Math.min(f.width, f.height) / 2 / Math.tan(c.fov * Math.PI / 360);
  saveText({
    camera_model: 'OPENCV', w: f.width, h: f.height, cx: f.width / 2, cy: f.height / 2,
    frames: path.map((c, i) => ({file_path: `path_${String(i).padStart(4, '0')}`, fl_x: focal(c),
      fl_y: focal(c), transform_matrix: rows4(toNerfstudio(c))})),
  }, 'transforms.json');
  tellLost('transforms.json');
}

/* The vertical field of view of a frame of transforms JSON, in degrees. */
function fovOf(read, k) {
  const of = (name) => Number(k[name] ?? read[name]);
  const h = of('h'), w = of('w'), fl = of('fl_y') || of('fl_x');
  if (h > 0 && fl > 0) return 360 / Math.PI * Math.atan(h / 2 / fl);
  const across = of('camera_angle_x');
  return of('camera_angle_y') * 180 / Math.PI || (across > 0 ? 360 / Math.PI *
    Math.atan(Math.tan(across / 2) * (h > 0 && w > 0 ? h / w : 1)) : 50);
}

const DATAPARSER = 'dataparser_transforms.json';

/* Numbers as rows of a rotation, to 1e-3, and a shift; null if they are none. */
function rowsOf(given) {
  const rows = Array.isArray(given) ? given.slice(0, 3) : [];
  const right = rows.length === 3 && rows.every((row) =>
    Array.isArray(row) && row.length >= 4 && row.slice(0, 4).every(Number.isFinite)) &&
    rows.every((a, i) => rows.every((b, k) => Math.abs(dot(a, b) - (i === k)) < 1e-3)) &&
    dot(cross(rows[0], rows[1]), rows[2]) > 0;
  return right ? rows : null;
}

/* What brings poses from nerfstudio's frame to the scene's, by its file: render/pose_frame.c's
 * twin. Directions by turned, places by placed; lengths grow by `scale`. */
function frameOf(read) {
  const theirs = rowsOf(read.transform), own = facts.applied.transform;
  if (!theirs || !(read.scale > 0))
    throw new Error(`${DATAPARSER} has no transform, a rotation and a shift in 3 rows of 4 ` +
      'numbers, or no scale above 0');
  const scale = facts.applied.scale / read.scale;
  const turned = (v) => {
    const back = [0, 1, 2].map((a) => dot(theirs.map((row) => row[a]), v));
    return own.map((row) => dot(row, back));
  };
  const placed = (p) => turned(p.map((v, a) => v * scale - theirs[a][3]))
    .map((v, a) => v + own[a][3]);
  return {scale, turned, placed};
}

/* The box of a path in that frame: its middle, its sides and its turn. */
function moveCrop(box, frame) {
  const middle = frame.placed([0, 1, 2].map((a) => (box.sides[a] + box.sides[3 + a]) / 2));
  const half = [0, 1, 2].map((a) => frame.scale * (box.sides[3 + a] - box.sides[a]) / 2);
  return {background: box.background, degrees: turnOfAxes(axesOfTurn(box.degrees)
    .map(frame.turned)), sides: [-1, 1].flatMap((s) => middle.map((v, a) => v + s * half[a]))};
}

/* A path, with nerfstudio's file of its frame beside it or not. */
function openFiles(files) {
  const frames = files.filter((f) => f.name === DATAPARSER);
  const paths = files.filter((f) => f.name !== DATAPARSER);
  if (paths.length === 1) openPath(paths[0], frames[0]);
  else if (files.length)
    say(`Open one camera path, with its ${DATAPARSER} if nerfstudio wrote it.`);
}

/* Opens a file as a whole: one that cannot be read changes nothing. */
async function openPath(file, frameFile = null) {
  try {
    const read = JSON.parse(await file.text());
    const foreign = !read.frames && read.poses_in !== 'scene';
    const toScene = foreign && frameFile ? frameOf(JSON.parse(await frameFile.text())) : null;
    const few = (list) => list.length <= 50 ? list : Array.from({length: 50}, (_, i) =>
      list[Math.round(i * (list.length - 1) / 49)]);
    const views = (read.keyframes || []).length > 1 ? null : read.camera_path || read.frames || [];
    const from = views ? few(views) : read.keyframes;
    const found = from.map((k) => {
      const c = fromNerfstudio(k.matrix || k.camera_to_world || k.transform_matrix);
      const high = Number(k.fov) || fovOf(read, k);
      const shorter = Math.min(1, Number(k.aspect) || Number(k.w ?? read.w) / (k.h ?? read.h) || 1);
      c.fov = 360 / Math.PI * Math.atan(Math.tan(high * Math.PI / 360) * shorter);
      if (toScene) Object.assign(c, {p: toScene.placed(c.p), r: c.r.map(toScene.turned)});
      c.distance = facts.distance;
      straighten(c);
      return c;
    });
    if (found.length < 2) throw new Error('it has fewer than two views');
    const own = readCrop(read.crop), box = own && toScene ? moveCrop(own, toScene) : own;
    keyframes = found;
    if (read.fps > 0) $('fps').value = read.fps;
    if (read.seconds > 0) $('seconds').value = read.seconds;
    else if (views) $('seconds').value = views.length / perSecond(); /* as many as it has */
    $('cycle').checked = Boolean(read.is_cycle);
    openCrop(box);
    listKeys();
    fly(keyframes[0]);
    const told = [];
    if (views && views.length > from.length)
      told.push(`${file.name} has ${views.length} views: the path goes through ${from.length} ` +
        'of them.');
    if (foreign && !toScene)
      told.push(`${file.name} counts as in the scene's own frame: if nerfstudio wrote it, open ` +
        `its ${DATAPARSER} together with it.`);
    if (toScene && !facts.applied.known)
      told.push('The scene is not there, so whether its transforms.json has an ' +
        "applied_transform, which nerfstudio's frame does not count, is not known.");
    if (told.length) say(told.join(' '));
  } catch (error) {
    say(`${file.name} is not a camera path: ${error.message}`);
  }
}

/* ---- a film of the path ---- */

const FILM_FRAMES = 7200; /* the server takes no more */
let film = null; /* {name, cancelled} while it is made */

async function posted(path, query) {
  const answer = await post(path, query);
  if (!answer.ok) throw new Error(await refusal(answer));
  return answer.json();
}

function filmSize() {
  const even = (n) => 2 * Math.max(8, Math.round(n / 2));
  if ($('film-size').value !== 'window') return $('film-size').value.split('x').map(Number);
  const f = frame();
  return [even(f.width), even(f.height)];
}

/* Frame by frame, as the page looks when it begins; what it has, the server keeps until the next
 * film. A cancelled film, and that of a page that is closed, is dropped. */
async function makeFilm() {
  if (film) {
    film.cancelled = true;
    return;
  }
  const path = framesOfPath(FILM_FRAMES), [width, height] = filmSize();
  if (!path) return;
  const state = film = {name: null, cancelled: false}, shared = {...looks(), ...cropQuery()};
  const began = performance.now(), note = (text, loud = true) => {
    $('film-state').textContent = text;
    if (loud) tell(`Film: ${text}`);
  };
  let tenth = 0;
  $('film-part').hidden = false;
  $('film-link').hidden = true;
  $('make-film').textContent = 'Cancel';
  note('begins');
  try {
    const made = await posted('film/begin', {width, height, fps: perSecond(),
      frames: path.length});
    state.name = made.film;
    for (let i = 0; i < path.length && !state.cancelled; i++) {
      const c = path[i], focal = Math.min(width, height) / 2 / Math.tan(c.fov * Math.PI / 360);
      $('film-bar').value = i / path.length;
      await posted('film/frame', {film: state.name, pose: toPose(c).join(','), focal, width,
        height, ...shared});
      const left = (performance.now() - began) / 1000 / (i + 1) * (path.length - i - 1);
      const share = Math.floor(10 * (i + 1) / path.length);
      note(`frame ${i + 1} of ${path.length}, ${duration(left)} left`, share > tenth);
      tenth = share;
    }
    if (state.cancelled) {
      await post('film/drop', {film: state.name});
      note('cancelled');
    } else {
      note('being completed');
      const whole = await posted('film/end', {film: state.name});
      $('film-bar').value = 1;
      note(`${path.length} frames, ${(whole.bytes / 1e6).toFixed(1)} MB`);
      $('film-link').href = `film?film=${state.name}`;
      $('film-link').download = whole.file;
      $('film-link').hidden = false;
    }
  } catch (error) {
    note(`No film: ${error.message}`);
    if (state.name) post('film/drop', {film: state.name}).catch(() => {});
  }
  film = null;
  $('make-film').textContent = 'Render film';
}

addEventListener('beforeunload', (event) => {
  if (film) event.preventDefault(); // the browser asks whether to leave
});
addEventListener('pagehide', () => {
  keepPath();
  if (film && film.name) post('film/drop', {film: film.name}, {keepalive: true});
});
