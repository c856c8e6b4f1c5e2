/* The viewer's crop box: only what is inside of it is shown. Its sides and its turn by sliders,
 * what requests and `render` are given of it, and its lines in the picture. Vectors, cameras and
 * lines are page.js's. */
'use strict';

/* [x0, y0, z0, x1, y1, z1] along the box's own axes, which are turned about the middle of
 * facts.box; a side of facts.box itself is no side. */
let crop = null;
let cropTurn = [0, 0, 0]; /* degrees about x, then y, then z */
const FAR = 1e4; /* times the box: beyond everything, where the scene does not end with it */

const isTurned = () => cropTurn.some((v) => v !== 0);
const cropMiddle = () => [0, 1, 2].map((a) => (facts.box[a] + facts.box[3 + a]) / 2);
/* How far from the middle the scene reaches along the box's axes: facts.box is a cube, whose
 * corners are farther away than its faces. */
const cropReach = () => (isTurned() ? Math.sqrt(3) : 1) * (facts.box[3] - facts.box[0]) / 2;
const isSide = (i) => crop[i] !== facts.box[i] &&
  Math.abs(crop[i] - cropMiddle()[i % 3]) < cropReach();

/* The axes that degrees about x, then y, then z make of x, y and z; and the other way. */
function axesOfTurn(degrees) {
  const about = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
  return about.map((axis) => degrees.reduce((v, angle, a) =>
    turn(v, about[a], angle * Math.PI / 180), axis));
}

function turnOfAxes([x, y, z]) {
  const flat = Math.hypot(x[0], x[1]) < 1e-9; /* y by a quarter turn: x and z are one axis */
  return [flat ? 0 : Math.atan2(y[2], z[2]), Math.atan2(-x[2], Math.hypot(x[0], x[1])),
    flat ? Math.atan2(-y[0], y[1]) : Math.atan2(x[1], x[0])].map((v) => v * 180 / Math.PI);
}

/* The box's axes in the scene. */
const cropAxes = () => axesOfTurn(cropTurn);

/* A place given along the box's axes, in the scene; and the other way. */
function fromCrop(place) {
  const middle = cropMiddle();
  return cropAxes().reduce((sum, axis, a) => add(sum, axis, place[a] - middle[a]), middle);
}

function toCrop(point) {
  const middle = cropMiddle(), from = add(point, middle, -1);
  return cropAxes().map((axis, a) => middle[a] + dot(axis, from));
}

/* What a picture is asked with: the numbers of --crop, of a box turned about its own middle. */
function cropSides() {
  const far = facts.endless ? FAR : 1;
  const sides = crop.map((v, i) => {
    const low = facts.box[i % 3], high = facts.box[3 + i % 3];
    if (isSide(i) || !(facts.endless || isTurned())) return v;
    return i < 3 ? low - far * (high - low) : high + far * (high - low);
  });
  if (!isTurned()) return sides;
  const own = [0, 1, 2].map((a) => (sides[a] + sides[a + 3]) / 2), middle = fromCrop(own);
  return [...sides.map((v, i) => v - own[i % 3] + middle[i % 3]), ...cropTurn];
}

/* Takes over such a box. */
function setCrop(sides, degrees) {
  cropTurn = [...degrees];
  const middle = [0, 1, 2].map((a) => (sides[a] + sides[a + 3]) / 2), own = toCrop(middle);
  crop = sides.map((v, i) => isTurned() ? v - middle[i % 3] + own[i % 3] : v);
  $('crop').checked = true;
  changeCrop();
}

const isCropped = () => $('crop').checked && crop.some((v, i) => v !== facts.box[i]);
const cropQuery = () => isCropped() ? {crop: cropSides().join(',')} : {};

function addSlider(id, text, low, high, value, changed) {
  const row = document.createElement('label'), slider = document.createElement('input');
  const name = document.createElement('span');
  name.textContent = text;
  slider.type = 'range';
  Object.assign(slider, {min: low, max: high, value, id});
  slider.addEventListener('input', () => {
    changed(Number(slider.value));
    $('crop').checked = true;
    changeCrop();
  });
  row.className = 'row';
  const output = document.createElement('output');
  output.id = `${id}-text`;
  output.setAttribute('aria-live', 'off'); /* the slider itself tells it */
  row.append(name, slider, output);
  $('crop-sliders').append(row);
}

function makeCrop() {
  crop = [...facts.box];
  for (let i = 0; i < 6; i++) {
    const a = i % 3, low = facts.box[a], high = facts.box[3 + a];
    addSlider(`crop-${i}`, `${'xyz'[a]} ${i < 3 ? 'from' : 'to'}`, 0, 1000, i < 3 ? 0 : 1000,
      (value) => {
        const share = value / 1000, least = (high - low) / 1000;
        crop[i] = share === 0 ? low : share === 1 ? high : low + share * (high - low);
        if (i < 3) crop[i] = Math.min(crop[i], crop[3 + a] - least);
        else crop[i] = Math.max(crop[i], crop[a] + least);
      });
  }
  for (let a = 0; a < 3; a++)
    addSlider(`crop-turn-${a}`, `turn ${'xyz'[a]}`, -180, 180, 0, (value) => turnCrop(a, value));
  changeCrop();
}

/* About its own middle: what is a side moves along with it. */
function turnCrop(a, degrees) {
  const own = [0, 1, 2].map((k) => (crop[k] + crop[k + 3]) / 2), middle = fromCrop(own);
  const sides = crop.map((_, i) => isSide(i));
  cropTurn[a] = degrees;
  const now = toCrop(middle);
  crop = crop.map((v, i) => sides[i] ? v + now[i % 3] - own[i % 3] : v);
}

function tellSlider(slider, text) {
  write(`${slider.id}-text`, text);
  slider.setAttribute('aria-valuetext', text);
}

function changeCrop() {
  const digits = Math.max(0, 3 - Math.floor(Math.log10(facts.box[3] - facts.box[0])));
  crop.forEach((v, i) => {
    const low = facts.box[i % 3], high = facts.box[3 + i % 3], slider = $(`crop-${i}`);
    slider.value = Math.round(1000 * (v - low) / (high - low));
    tellSlider(slider, isSide(i) ? v.toFixed(Math.min(digits, 9)) : 'all');
  });
  cropTurn.forEach((v, a) => {
    $(`crop-turn-${a}`).value = Math.round(v);
    tellSlider($(`crop-turn-${a}`), `${Number(v.toFixed(1))}°`);
  });
  write('crop-text', isCropped() ? `--crop ${cropSides().map((v) =>
    Number(v.toPrecision(15))).join(',')}` : 'the box is off');
  touch(true);
}

function resetCrop() {
  crop = [...facts.box];
  cropTurn = [0, 0, 0];
  changeCrop();
}

function drawCrop(f) {
  const shown = crop.map((v, i) => isSide(i) ? v : facts.box[i]);
  const corner = (k) => project(fromCrop([0, 1, 2].map((a) => shown[k >> a & 1 ? 3 + a : a])), f);
  for (let k = 0; k < 8; k++)
    for (let a = 0; a < 3; a++)
      if (!(k >> a & 1)) line([corner(k), corner(k | 1 << a)], '#8a63d2');
}
