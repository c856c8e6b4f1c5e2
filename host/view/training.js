/* The viewer's panel of a training: how it stands, its curve, pause, save and stop; and the word of
 * a run that is trained elsewhere. Requests and messages are page.js's. */
'use strict';

function duration(s) {
  const two = (n) => String(Math.floor(n)).padStart(2, '0');
  return s < 3600 ? `${Math.floor(s / 60)}:${two(s % 60)}` :
    `${Math.floor(s / 3600)}:${two(s / 60 % 60)}:${two(s % 60)}`;
}

const short = (n) => n >= 1e6 ? `${(n / 1e6).toFixed(1)} M` :
  n >= 1e4 ? `${(n / 1e3).toFixed(0)} k` : n.toFixed(0);

function svg(name, values, text) {
  const node = document.createElementNS('http://www.w3.org/2000/svg', name);
  for (const [key, value] of Object.entries(values)) node.setAttribute(key, value);
  if (text !== undefined) node.textContent = text;
  return node;
}

/* Some round values between two. */
function ticks(low, high) {
  const raw = (high - low) / 4, power = 10 ** Math.floor(Math.log10(raw));
  const step = power * [1, 2, 5, 10].find((k) => k * power >= raw);
  const list = [];
  for (let v = Math.ceil(low / step) * step; v <= high + 1e-9 * step; v += step) list.push(v);
  return list;
}

/* PSNR against seconds of training. */
function drawCurve(rows) {
  const values = rows.flatMap((r) => [r[1], r[2]]).filter((v) => v !== null);
  $('curve').replaceChildren();
  if (rows.length < 2 || values.length < 2) return;
  const end = rows[rows.length - 1][0], low = Math.min(...values) - 0.5;
  const high = Math.max(...values) + 0.5;
  const x = (v) => 28 + 246 * v / end, y = (v) => 112 - 106 * (v - low) / (high - low);
  const put = (...all) => $('curve').append(svg(...all));
  for (const v of ticks(low, high)) {
    put('line', {class: 'grid', x1: 28, x2: 274, y1: y(v), y2: y(v)});
    put('text', {x: 24, y: y(v) + 3, 'text-anchor': 'end'}, Number(v.toFixed(6)));
  }
  for (const v of [0, end / 2, end])
    put('text', {x: x(v), y: 126, 'text-anchor': v === end ? 'end' : v ? 'middle' : 'start'},
      duration(v));
  const path = (column) => rows.filter((r) => r[column] !== null)
    .map((r) => `${x(r[0]).toFixed(1)},${y(r[column]).toFixed(1)}`).join(' ');
  put('polyline', {class: 'train', points: path(1)});
  put('polyline', {class: 'test', points: path(2)});
  for (const r of rows)
    if (r[2] !== null) put('circle', {cx: x(r[0]), cy: y(r[2]), r: 2.5});
}

let shownState = null;

function showTraining() {
  const t = training, real = (v, digits) => v === null ? '–' : v.toFixed(digits);
  const left = t.eta === null ? '' : `, ${duration(t.eta)} left`;
  $('title').textContent = `${facts.run}, step ${t.step.toLocaleString('en')}`;
  $('training-state').textContent = `${t.state}: ${(100 * t.fraction).toFixed(0)} %` +
    (t.state === 'paused' ? '' : left);
  $('training-bar').value = t.fraction;
  if (shownState !== t.state) tell(`The training: ${t.state}`);
  shownState = t.state;
  $('pause').textContent = t.state === 'paused' ? 'Continue' : 'Pause';
  const list = [['PSNR, training', `${real(t.psnr_train, 2)} dB`],
    ['PSNR, test', t.psnr_test === null ? 'not yet measured' : `${real(t.psnr_test, 2)} dB`],
    ['trained', duration(t.seconds)], ['leaves', t.leaves.toLocaleString('en')],
    ['rays a second', t.rays_per_s === null ? '–' : short(t.rays_per_s)],
    ['saved', t.saved_step === null ? 'not yet' : `step ${t.saved_step.toLocaleString('en')}`],
    ['viewing', `${(100 * t.viewing).toFixed(0)} % of the time`]];
  $('training-facts').replaceChildren(...list.flatMap(([name, value]) => {
    const dt = document.createElement('dt'), dd = document.createElement('dd');
    dt.textContent = name;
    dd.textContent = value;
    return [dt, dd];
  }));
  drawCurve(t.curve);
  const stages = Object.entries(t.stages).sort((a, b) => b[1] - a[1]);
  const sum = stages.reduce((all, [, s]) => all + s, 0) || 1;
  $('stages').replaceChildren(...stages.map(([name, s]) => {
    const row = document.createElement('tr');
    const head = document.createElement('th');
    head.scope = 'row';
    head.textContent = name;
    row.append(head);
    row.insertCell().textContent = `${(100 * s / sum).toFixed(1)} %`;
    return row;
  }));
}

async function watch() {
  await seen();
  try {
    const answer = await request('training');
    if (left) return;
    if (!answer.ok) throw new Error();
    training = await answer.json();
    if (ended) say('');
    ended = false;
    showTraining();
    pump();
  } catch (error) {
    ended = true;
    $('training-state').textContent = 'ended, or the way to it is cut';
    say(gone());
  }
  for (const id of ['pause', 'checkpoint', 'stop']) $(id).disabled = ended;
  setTimeout(watch, 1000);
}

async function order(what) {
  try {
    const answer = await post(what, {});
    if (!answer.ok && !left) say(await refusal(answer));
  } catch (error) {
    say(gone());
  }
}

/* Of a run that is trained elsewhere: this viewer goes on showing the model that it opened. */
async function lookForNewer() {
  await seen();
  try {
    const answer = await request('newest');
    if (left) return;
    const {newer, gone: lost} = await answer.json();
    const text = lost ? 'The run is no longer in its folder; what is shown is in memory, until ' +
      'view ends.' : newer === null ? '' : `The run has another model by now, of step ` +
      `${newer.toLocaleString('en')}; to see it, start view again.`;
    if ($('newer').textContent !== text) say(text);
    $('newer').textContent = text;
  } catch (error) {
    /* the next picture tells */
  }
  setTimeout(lookForNewer, 5000);
}

/* The second click stops the training, unless the button was left in between. */
function stopTraining() {
  const button = $('stop'), sure = button.textContent !== 'Stop';
  button.textContent = sure ? 'Stop' : 'Really stop?';
  if (sure) order('stop');
  else say('Once more stops the training; Escape or another control takes it back.');
}

function keepTraining() {
  $('stop').textContent = 'Stop';
}
