"""The checks of browser.sh: drives Chromium by WebDriver's plain HTTP, with Python's own library.

    browser.py ADDRESS RENDERED FOLDER PAGES

RENDERED is the PNG that `render` made of the first test view, or "training": ADDRESS is that of a
training, which is steered and stopped, and then that of another viewer, which the arguments after
PAGES start (a port is added); or "documents": ADDRESS is a folder with report.html and
check.html. Screenshots go to FOLDER. PAGES: names, with spaces. A line per check on standard
output, "ok" or "FAILED".
"""
import base64
import json
import math
import re
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request

ADDRESS, RENDERED, FOLDER, PAGES, *NEXT = sys.argv[1:]
TEST_VIEW = 20  # after 20 training views
MEAN = """
    const b = last.box, c = new OffscreenCanvas(64, 64), p = c.getContext('2d');
    p.drawImage(picture, b.x, b.y, b.width, b.height, 0, 0, 64, 64);
    const data = p.getImageData(0, 0, 64, 64).data;
    return data.reduce((s, v, i) => s + (i % 4 < 3 ? v : 0), 0) / data.length * 4 / 3;"""
# The same of the photo's difference from the picture, four times.
DIFFERENCE = """
    const b = last.box, paint = (image, x, y, w, h) => {
      const c = new OffscreenCanvas(b.width, b.height), p = c.getContext('2d');
      p.drawImage(image, x, y, w, h, 0, 0, b.width, b.height);
      return p.getImageData(0, 0, b.width, b.height).data;
    };
    const one = paint(last.bitmap, 0, 0, last.bitmap.width, last.bitmap.height);
    const other = paint(photo, 0, 0, photo.width, photo.height);
    return one.reduce((s, v, i) => s + (i % 4 < 3 ? Math.min(255, 4 * Math.abs(v - other[i])) : 0),
      0) / one.length * 4 / 3;"""
KEYS = {'left': '\ue012', 'up': '\ue013', 'shift': '\ue008', 'tab': '\ue004', 'enter': '\ue007',
        'escape': '\ue00c'}


def free_port():
    with socket.socket() as s:
        s.bind(('127.0.0.1', 0))
        return s.getsockname()[1]


class Driver:
    def __init__(self):
        self.base = f'http://127.0.0.1:{free_port()}'
        self.process = subprocess.Popen(['chromedriver', '--port=' + self.base.split(':')[2]],
                                        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        for _ in range(100):
            try:
                self.call('GET', '/status')
                return
            except OSError:
                time.sleep(0.1)
        raise SystemExit('chromedriver does not answer')

    def call(self, method, path, body=None):
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(self.base + path, method=method, data=data,
                                         headers={'Content-Type': 'application/json'})
        try:
            with urllib.request.urlopen(request, timeout=300) as answer:
                return json.load(answer)['value']
        except urllib.error.HTTPError as error:
            said = json.load(error).get('value', {}).get('message', '')
            raise SystemExit(f'{path} {str(body)[:200]}: {said.splitlines()[:1]}') from None


class Page:
    """A window of a width and height; phone: with touch and a sharp screen."""

    def __init__(self, driver, name, width, height, dark=False, phone=False, document=None):
        options = {'args': ['--headless=new', '--no-sandbox', '--disable-gpu',
                            '--disable-dev-shm-usage', f'--window-size={width},{height}']}
        if dark:
            options['args'].append('--force-dark-mode')
        if phone:
            options['mobileEmulation'] = {'deviceMetrics': {
                'width': width, 'height': height, 'pixelRatio': 2, 'touch': True}}
        self.driver, self.name, self.pointer = driver, name, 'touch' if phone else 'mouse'
        wanted = {'goog:chromeOptions': options,
                  'goog:loggingPrefs': {'browser': 'ALL', 'performance': 'ALL'}}
        made = driver.call('POST', '/session', {'capabilities': {'alwaysMatch': wanted}})
        self.path = '/session/' + made['sessionId']
        self.call('/timeouts', {'script': 240000})
        self.call('/url', {'url': f'{ADDRESS}/{document}' if document else ADDRESS})
        if not document:
            self.settle()

    def call(self, path, body):
        return self.driver.call('POST', self.path + path, body)

    def js(self, script, *given):
        return self.call('/execute/sync', {'script': script, 'args': given})

    def later(self, script, *given):
        """The script calls done(VALUE)."""
        return self.call('/execute/async', {
            'script': 'const done = arguments[arguments.length - 1];' + script, 'args': given})

    def settle(self, seconds=60):
        """Until the picture is sharp, or that of a moment of a training."""
        end = time.time() + seconds
        while time.time() < end:
            if self.js('return last !== null && (isNew() || (underWay() && last.ms === WHOLE_MS)) '
                       '&& last.version === version && '
                       '!playing && performance.now() - moved > 500'):
                return
            time.sleep(0.1)
        raise SystemExit('the picture does not become sharp: ' +
                         self.js('return document.getElementById("message").textContent'))

    def key(self, *values):
        for value in values:
            self.call('/actions', {'actions': [{'type': 'key', 'id': 'keys', 'actions': [
                {'type': 'keyDown', 'value': value}, {'type': 'keyUp', 'value': value}]}]})

    def point(self, *steps):
        """Steps as (x, y) from the picture's middle, 'down', 'up', or seconds to wait."""
        x, y = self.js('const b = picture.getBoundingClientRect();'
                       'return [b.x + b.width / 2, b.y + b.height / 2]')
        actions = []
        for step in steps:
            if isinstance(step, tuple):
                actions.append({'type': 'pointerMove', 'duration': 100, 'x': int(x + step[0]),
                                'y': int(y + step[1])})
            elif isinstance(step, str):
                actions.append({'type': 'pointer' + step.capitalize(), 'button': 0})
            else:
                actions.append({'type': 'pause', 'duration': int(1000 * step)})
        self.call('/actions', {'actions': [{'type': 'pointer', 'id': self.pointer, 'parameters': {
            'pointerType': self.pointer}, 'actions': actions}]})

    def shot(self, what):
        data = self.driver.call('GET', self.path + '/screenshot')
        with open(f'{FOLDER}/{self.name}-{what}.png', 'wb') as file:
            file.write(base64.b64decode(data))

    def check(self, what, passed, detail=''):
        print(f'{"ok     " if passed else "FAILED "} {self.name}: {what}'
              f'{"" if passed else f" ({detail})"}', flush=True)

    def pose(self):
        return self.js('return toPose(camera)')

    def close(self):
        self.driver.call('DELETE', self.path)


def moved(a, b):
    return max(abs(x - y) for x, y in zip(a, b))


def turn_in_place(page):
    """As in a room: of an object, which the photos look at, it is a choice."""
    where = lambda pose: [pose[3], pose[7], pose[11]]
    forward = lambda pose: [pose[2], pose[6], pose[10]]
    time.sleep(0.6)
    page.check('of an object drags turn about it', not page.js('return isInside()'))
    page.key('i')
    at = page.pose()
    page.point((0, 0), 'down', (30, 10), (90, 20), 'up')
    then = page.pose()
    page.check('I: a drag looks around from the same place',
               moved(where(at), where(then)) < 1e-9 and moved(forward(at), forward(then)) > 0.05)
    right = [at[0], at[4], at[8]]
    page.check('what is under the pointer follows it',
               sum(a * b for a, b in zip(right, forward(then))) < 0)
    page.key(KEYS['left'])
    page.check('an arrow key turns the same way',
               sum(a * b for a, b in zip([then[0], then[4], then[8]], forward(page.pose()))) < 0 and
               moved(where(at), where(page.pose())) < 1e-9)
    turned = forward(page.pose())
    page.key('+')
    page.check('+ goes ahead',
               sum(a * (x - y) for a, x, y in zip(turned, where(page.pose()), where(at))) > 0.01)
    page.check('photos from inside, in all directions, are told from others', page.js('''
        const c = (p, f) => ({pose: toPose({p, r: [[1, 0, 0], [0, 1, 0], f]})});
        const ring = [0, 1, 2, 3, 4, 5].map((k) => [Math.cos(k), Math.sin(k), 0]);
        return areInside(ring.map((v) => c(v, v))) && areInside(ring.map((v) => c([0, 0, 0], v))) &&
            !areInside(ring.map((v) => c(v, scale(v, -1)))) &&
            !areInside(ring.map((v) => c(v, [0, 0, 1]))) && !areInside([]) &&
            areInside(ring.map((v) => ({...c(v, [0, 0, 1]), around: true})))'''))
    page.key('i')
    page.key('h')


def look_around(page):
    at = page.pose()
    page.point((0, 0), 'down', (30, 10), (90, 20), 'up')
    page.check('a drag turns the camera', moved(at, page.pose()) > 0.1)
    page.settle()
    page.check('the picture is sharp at rest', page.js('return last.width === last.box.width'))
    asked = page.js('return performance.getEntriesByType("resource").map((e) => e.name)')
    page.check('pixels at edges are as the model learnt them',
               page.js('return last.finer') == 0 and any('edges=1' in name for name in asked))
    page.shot('dragged')
    page.key('h')
    time.sleep(0.6)
    page.settle()
    page.check('H returns to the first view', moved(at, page.pose()) < 1e-9, page.pose())
    before = page.js('return pivot(camera)')
    page.point((0, 10), 'down', 'up', 0.08, 'down', 'up')
    time.sleep(1.2)
    page.settle()
    page.check('a double click turns to that point',
               moved(before, page.js('return pivot(camera)')) > 1e-3)
    place = "return document.getElementById('place').textContent"
    told = page.js(place)
    numbers = [float(x) for x in told.removeprefix('x, y, z: ').split(',')]
    page.check('and tells where it is, alone',
               moved(numbers, page.js('return pivot(camera)')) < 2e-3, told)
    page.key('g')
    time.sleep(1.2)
    page.settle()
    page.check('the next one also tells how far it is', 'from the point before' in page.js(place),
               page.js(place))
    distance = page.js('return camera.distance')
    page.key('+', '+')
    page.check('+ goes nearer', page.js('return camera.distance') < 0.85 * distance)
    at = page.pose()
    page.key(KEYS['left'])
    page.check('an arrow key turns the camera', moved(at, page.pose()) > 0.01)
    at = page.pose()
    page.call('/actions', {'actions': [{'type': 'key', 'id': 'keys', 'actions': [
        {'type': 'keyDown', 'value': 'w'}, {'type': 'pause', 'duration': 300},
        {'type': 'keyUp', 'value': 'w'}]}]})
    page.check('W flies', moved(at, page.pose()) > 0.01)
    page.key('h')
    turn_in_place(page)


def see_cameras(page):
    """The picture on the page at the test view, against render's, in dB."""
    page.key('c')
    time.sleep(0.6)
    page.settle()
    page.shot('frusta')
    count = page.js('return document.querySelectorAll("#cameras li").length')
    page.check('all cameras are listed', count == 22, count)
    page.js('jump(arguments[0])', TEST_VIEW)
    time.sleep(1)
    page.settle()
    with open(RENDERED, 'rb') as file:
        wanted = base64.b64encode(file.read()).decode()
    psnr = page.later('''
        const data = Uint8Array.from(atob(arguments[0]), (c) => c.charCodeAt(0));
        createImageBitmap(new Blob([data], {type: 'image/png'})).then((whole) => {
          const paint = (image, box) => {
            const c = new OffscreenCanvas(whole.width, whole.height), p = c.getContext('2d');
            p.imageSmoothingQuality = 'high';
            p.drawImage(image, ...box, 0, 0, c.width, c.height);
            return p.getImageData(0, 0, c.width, c.height).data;
          };
          const b = last.box, shown = paint(picture, [b.x, b.y, b.width, b.height]);
          const want = paint(whole, [0, 0, whole.width, whole.height]);
          const sum = shown.reduce((s, v, i) => s + (v - want[i]) ** 2, 0) * 4 / 3;
          done(10 * Math.log10(255 * 255 * shown.length / sum));
        });''', wanted)
    page.check('the page shows what render makes', psnr > 28, f'{psnr} dB')
    page.check('the view\'s photo is shown', page.js('return photo !== null && photo.width > 0'))
    page.key('b')
    page.check('B lays the photo over', page.js('return $("blend").value') == '1')
    page.js('$("blend").value = 0.5; draw()')
    page.shot('photo')
    page.key('b', 'b')
    before = page.js(MEAN)
    page.key('v')
    shown, wanted = page.js(MEAN), page.js(DIFFERENCE)
    page.check('V shows the error', abs(shown - wanted) < 0.1 * wanted + 0.5 and wanted > 1,
               f'{shown}, not {wanted}')
    page.shot('error')
    page.key('v')
    page.check('V again shows the render', abs(page.js(MEAN) - before) < 1, page.js(MEAN))
    colour = page.js('return $("background").value')
    change = ('$("background").value = arguments[0];'
              '$("background").dispatchEvent(new Event("input"))')
    page.js(change, '#0000ff')
    page.check('the photo has the background that was chosen',
               wait_for(page, 'photo !== null && photo.src.endsWith("background=0,0,1")'))
    page.js(change, colour)
    page.check('and its own again', wait_for(
        page, 'coming === null && photo.src.endsWith("background=" + background().join(","))'))
    page.settle()
    for key, what in (('2', 'depth'), ('3', 'opacity'), ('4', 'level'), ('5', 'error')):
        page.key(key)
        time.sleep(0.6)
        page.settle()
        page.shot(what)
        page.check(f'{key} shows {what}', page.js('return $("show").value') == what)
        legend = page.js('return $("legend").hidden ? -1 : $("legend").children.length')
        levels = page.js('return facts.levels.length')
        wanted = {'level': (levels,), 'error': (5, 0)}.get(what, (-1,))  # 0: only a sentence
        page.check('only pictures of leaves have a legend', legend in wanted, legend)
        if what == 'depth':
            small = page.js('const was = facts.half; facts.half *= 1e-6; draw();'
                            'const text = $("numbers").textContent; facts.half = was; draw();'
                            'return text')
            page.check('depths have the digits that the cube needs',
                       re.search(r' depth \d+\.\d{8,10} to ', small), small)
    page.key('1', 'n')
    time.sleep(1)
    page.check('N is the next camera', page.js('return at') == TEST_VIEW + 1)
    page.key('h', 'c')
    time.sleep(0.6)


def axes_of(degrees):
    """The axes of a box turned about x, then y, then z, as columns, without the page's code."""
    rows = [[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]]
    for a, angle in enumerate(degrees):
        c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
        i, j = (a + 1) % 3, (a + 2) % 3
        rows[i], rows[j] = ([c * u - s * v for u, v in zip(rows[i], rows[j])],
                            [s * u + c * v for u, v in zip(rows[i], rows[j])])
    return rows


def in_box(numbers, point):
    """Is a point in the box of these numbers of --crop?"""
    middle = [(numbers[a] + numbers[a + 3]) / 2 for a in range(3)]
    rows = axes_of((numbers + [0, 0, 0])[6:9])
    along = [sum(rows[k][a] * (point[k] - middle[k]) for k in range(3)) for a in range(3)]
    return all(abs(v) <= (numbers[a + 3] - numbers[a]) / 2 for a, v in enumerate(along))


def turn_box(page):
    """Turns the box by sliders, saves it with a path and opens it again."""
    middle = page.js('return fromCrop([0, 1, 2].map((a) => (crop[a] + crop[a + 3]) / 2))')
    crop = page.js('return crop')
    for axis, degrees in ((0, 20), (2, -35)):
        page.js('const s = $(`crop-turn-${arguments[0]}`); s.value = arguments[1];'
                's.dispatchEvent(new Event("input"))', axis, degrees)
    time.sleep(0.6)
    page.settle()
    page.shot('turned')
    numbers = page.js('return cropSides()')
    page.check('a turned box has nine numbers', numbers[6:] == [20, 0, -35], numbers)
    now = page.js('return [crop, fromCrop([0, 1, 2].map((a) => (crop[a] + crop[a + 3]) / 2))]')
    sides = [i for i in range(6) if page.js('return isSide(arguments[0])', i)]
    page.check('a turned box keeps its set sides', sides == [0, 4], sides)
    page.check('the set sides turn with the box',
               moved(now[0], crop) > 1e-3 and moved(now[1], middle) < 1, now)
    inside, differ = 0, 0
    box = page.js('return facts.box')
    for i in range(0, 2000, 10):
        point = [box[a] + (box[a + 3] - box[a]) * ((i * step) % 1)
                 for a, step in ((0, 0.754877), (1, 0.569840), (2, 0.381966))]
        own = page.js('return toCrop(arguments[0])', point)
        wanted = own[0] >= now[0][0] and own[1] <= now[0][4]
        inside += wanted
        differ += wanted != in_box(numbers, point)
    page.check('page and --crop agree on what is inside', differ == 0 and 10 < inside < 190,
               f'{differ} differ, {inside} inside')
    again = page.js('''
        const read = JSON.parse(JSON.stringify({crop: cropOfPath()}));
        resetCrop();
        openCrop(readCrop(read.crop));
        return cropSides();''')
    page.check('a path keeps the box', moved(again, numbers) < 1e-6, again)
    small, turned, back = page.js('''
        const was = [crop, cropTurn], half = (facts.box[3] - facts.box[0]) / 2;
        const middle = cropMiddle(), near = [0.6, 0.6, -0.2, 0.9, 0.9, 0.2];
        setCrop(near.map((v, i) => middle[i % 3] + v * half), [0, 0, 0]);
        const small = cropSides().map((v, i) => v - cropMiddle()[i % 3]);
        turnCrop(2, 45);
        const turned = [0, 1, 2, 3, 4, 5].every(isSide);
        turnCrop(2, 0);
        const back = cropSides().map((v, i) => v - cropMiddle()[i % 3]);
        [crop, cropTurn] = was;
        changeCrop();
        return [small, turned, back];''')
    page.check('a box in a corner keeps its sides when turned', turned, turned)
    page.check('and has its old sides when turned back', moved(small, back) < 1e-6, back)
    time.sleep(0.6)
    page.settle()


def crop(page):
    page.js('openPanel(true); $("crop-part").open = true; $("crop-part").scrollIntoView()')
    page.settle()
    before = page.js(MEAN)
    for slider, value in ((0, 500), (4, 600)):
        page.js('const s = $(`crop-${arguments[0]}`); s.value = arguments[1];'
                's.dispatchEvent(new Event("input"))', slider, value)
    time.sleep(0.6)
    page.settle()
    page.shot('crop')
    box, of = page.js('return crop'), page.js('return facts.box')
    page.check('sliders make a box', abs(box[0] - (of[0] + of[3]) / 2) < 1e-9 and
               box[1] == of[1] and abs(box[4] - (of[1] + 0.6 * (of[4] - of[1]))) < 1e-9, box)
    page.check('the box cuts the picture', abs(page.js(MEAN) - before) > 1, page.js(MEAN))
    said = page.js('return $("crop-text").textContent').split(' ')
    page.check('the text is an option of render', said[0] == '--crop' and
               abs(float(said[1].split(',')[4]) - box[4]) < 1e-6, said)
    upright = page.js(MEAN)
    turn_box(page)
    page.check('a turned box cuts elsewhere', abs(page.js(MEAN) - upright) > 0.3, page.js(MEAN))
    page.js('document.activeElement.blur()')
    page.key('o')
    time.sleep(0.6)
    page.settle()
    page.check('O shows the whole scene', abs(page.js(MEAN) - before) < 0.5, page.js(MEAN))
    page.js('resetCrop(); $("crop-part").open = false')
    page.check('Reset turns the box back', page.js('return cropSides().length') == 6)
    page.settle()


def make_film(page):
    """Makes a film of the path: cancels it once, then finishes and saves it."""
    page.check('frames a second of broadcast stay', page.js(
        'const was = $("fps").value; $("fps").value = "23.976"; const now = perSecond();'
        '$("fps").value = was; return now') == 23.976)
    page.check('films can stand upright', page.js(
        '$("film-size").value = "1080x1920"; return filmSize()') == [1080, 1920])
    page.js('openPanel(true); $("path-part").open = true; $("film-size").value = "854x480";'
            '$("make-film").scrollIntoView(); $("make-film").click()')
    page.check('a film begins', wait_for(
        page, 'film && $("film-state").textContent.includes(" of ")'))
    page.js('$("make-film").click()')
    page.check('a film is cancelled', wait_for(
        page, '!film && $("film-state").textContent === "cancelled"'))
    page.js('$("make-film").click()')
    page.check('a film shows its progress', wait_for(
        page, '$("film-state").textContent.includes(" of 12, ")'))
    page.shot('film')
    page.check('a film is finished', wait_for(page, '!film && !$("film-link").hidden', 900),
               page.js('return $("film-state").textContent'))
    got = page.later("""
        fetch($("film-link").href).then((a) => a.blob()).then((b) => b.slice(0, 12).text().then(
          (t) => done([b.type, b.size, t])));""")
    page.check('the film can be saved', got[1] > 1000 and (got[2][4:8] == 'ftyp' or
               got[2].startswith('YUV4MPEG2')), got)
    page.check('the film has a name', page.js('return $("film-link").download').startswith('film.'))


def make_path(page):
    page.key('k', KEYS['left'], KEYS['left'], KEYS['up'], 'k', KEYS['left'], '+', 'k')
    page.js('openPanel(true); $("path-part").open = true; $("seconds").value = 0.5;'
            '$("path-part").scrollIntoView()')
    page.settle()
    page.shot('path')
    page.check('K adds views', page.js('return keyframes.length') == 3)
    saved = page.later('''
        const real = download;
        download = (blob) => blob.text().then((t) => done(JSON.parse(t)));
        savePath();
        download = real;''')
    frames = saved['camera_path']
    page.check('a path has all frames', len(frames) == 12, len(frames))
    page.check("it is in the scene's frame, by its word", saved['poses_in'] == 'scene')
    first, pose = frames[0]['camera_to_world'], page.js('return toPose(keyframes[0])')
    turned = [s * v for v, s in zip(pose, (1, -1, -1, 1) * 3)]
    page.check("its axes are OpenGL's, by rows", moved(first, turned + [0, 0, 0, 1]) < 1e-12, first)
    same = page.js('''
        const c = fromNerfstudio(arguments[0]);
        return toPose(c).map((v, i) => v - toPose(keyframes[1])[i])''',
                   saved['keyframes'][1]['matrix'])
    page.check('a saved keyframe is read back', max(map(abs, same)) < 1e-12, same)
    other = page.later('''
        const real = download;
        download = (blob) => blob.text().then((t) => done(JSON.parse(t)));
        saveTransforms();
        download = real;''')
    rows = other['frames'][0]['transform_matrix']
    page.check('transforms JSON has the same frames', sum(rows, []) == first and
               len(other['frames']) == 12, rows)
    fov = page.js('return [keyframes[0].fov, fovOf(arguments[0], arguments[0].frames[0])]', other)
    high = frames[0]['fov']
    page.check('transforms JSON has the fields of view', abs(fov[1] - high) < 1e-6, fov)
    count = page.later('''
        const text = JSON.stringify(arguments[0]), before = keyframes;
        openPath({name: 'transforms.json', text: async () => text}).then(() => {
          const n = keyframes.length;
          const c = toPose(keyframes[0]).map((v, i) => v - toPose(before[0])[i]);
          const off = Math.abs(keyframes[0].fov - before[0].fov);
          keyframes = before;
          listKeys();
          done([n, Math.max(...c.map(Math.abs)), off]);
        });''', other)
    page.check('transforms JSON is opened again',
               count[0] == 12 and count[1] < 1e-12 and count[2] < 1e-6, count)
    page.js('document.activeElement.blur()')
    page.key(' ')
    page.check('Space plays the path', page.js('return playing > 0'))
    time.sleep(1)
    page.settle()
    page.check('it plays to the end', moved(page.pose(), page.js('return toPose(along(1))')) < 1e-9)
    rolls = page.js("""
        const before = keyframes, start = copy(camera);
        level();
        const level0 = copy(camera);
        keyframes = [0, 2.6, 5].map((angle) => {
          const c = copy(level0);
          c.r = c.r.map((v) => turn(v, facts.up, angle));
          return c;
        });
        const at = Array.from({length: 41}, (_, i) => along(i / 40));
        const least = Math.min(...at.map((c) => size(cross(c.r[2], facts.up))));
        const most = Math.max(...at.map((c) => Math.abs(dot(c.r[0], facts.up))));
        const off = Math.max(...[0, 20, 40].map((i, k) =>
          size(add(at[i].r[0], keyframes[k].r[0], -1))));
        keyframes = before;
        camera = start;
        return [least, most, off]""")
    page.check('between level views it is level', rolls[0] > 0.5 and rolls[1] < 1e-9, rolls)
    page.check('and meets them', rolls[2] < 1e-9, rolls)


def come_back(page):
    """A page that is loaded again has its camera and its path; what files lack is said."""
    told = page.later("""
        const real = download, looked = $('background').value;
        download = () => {};
        $('background').value = '#ff8000';
        savePath();
        const path = $('message').textContent;
        saveTransforms();
        download = real;
        $('background').value = looked;
        done([path, $('message').textContent]);""")
    page.check('a file without the background says so',
               all('--background 1,0.50196,0' in text for text in told), told)
    before = page.js('return [keyframes.length, $("seconds").value]'), page.pose()
    page.js('location.reload()')
    page.check('the page comes back', wait_for(page, 'document.readyState === "complete" && '
                                                     'typeof last !== "undefined" && last'))
    after = page.js('return [keyframes.length, $("seconds").value]'), page.pose()
    page.check('with its path', after[0] == before[0], [before[0], after[0]])
    page.check('and its camera', moved(after[1], before[1]) < 1e-9)


def stop_path(page):
    """Whatever else moves the camera, or changes the path, ends a path that plays."""
    page.js('$("seconds").value = 20; document.activeElement.blur()')
    for what, act in (
            ('H', 'keys.h()'), ('a jump to a camera', 'jump(0)'), ('plus', 'keys["+"]()'),
            ('another field of view',
             '$("fov").value = 40; $("fov").dispatchEvent(new Event("input"))'),
            ('removal of a view', '$("keys-list").lastChild.lastChild.click()'),
            ('another path', 'openPath({name: "path", text: async () => JSON.stringify({keyframes: '
             'keyframes.map((c) => ({matrix: toNerfstudio(c), fov: 50}))})})')):
        page.js('play()')
        page.check(f'before {what}, the path plays', wait_for(page, 'playing > 0'))
        page.js(act)
        time.sleep(0.6)
        page.check(f'{what} ends the path', page.js('return playing') == 0)
        if 'jump' in what:
            page.check('it is at that camera', page.js('return at') == 0)
    page.js('keys.h(); play()')
    time.sleep(0.6)
    page.check('a path ends a flight', moved(page.pose(), page.js('return toPose(home)')) > 1e-3)
    page.js('keys.h()')
    time.sleep(0.6)
    page.check('the view is home again', moved(page.pose(), page.js('return toPose(home)')) < 1e-9)
    page.settle()


def fly_on(page):
    """N and P during a flight count from its goal; the user's hand ends it."""
    page.js('jump(2)')
    page.check('it is at a camera', wait_for(page, 'at === 2'))
    page.js('jumpBy(1); jumpBy(1)')
    page.check('N twice during a flight is the second next', wait_for(page, 'at >= 0') and
               page.js('return at') == 4, page.js('return at'))
    page.js('jumpBy(-1); jumpBy(-1); jumpBy(-1)')
    page.check('P thrice is the third one before', wait_for(page, 'at >= 0') and
               page.js('return at') == 1, page.js('return at'))
    page.js('jumpBy(1); orbit(0.06, 0)')
    at = page.pose()
    time.sleep(0.6)
    page.check('an orbit during a flight ends it', moved(at, page.pose()) < 1e-12)
    page.js('jumpBy(-1)')
    page.check('after it, P is the last camera', wait_for(page, 'at >= 0') and
               page.js('return at === facts.cameras.length - 1'), page.js('return at'))
    page.js('keys.h()')
    time.sleep(0.6)
    page.settle()


def tap(page):
    """One finger's double tap is one, that of two fingers is none; three fingers shift."""
    asked = page.js("""
        const realFocus = focus, was = tapped, seen = [];
        const at = (type, id, x) => picture.dispatchEvent(new PointerEvent(type,
          {pointerId: id, pointerType: 'touch', clientX: x, clientY: 300, button: 0, buttons: 1}));
        picture.setPointerCapture = () => {};
        focus = () => { seen[seen.length - 1]++; };
        tapped = -1000;
        seen.push(0);
        for (const id of [1, 2]) at('pointerdown', id, 100 * id);
        for (const id of [1, 2]) at('pointerup', id, 100 * id);
        tapped = -1000;
        seen.push(0);
        for (let i = 0; i < 2; i++)
          for (const type of ['pointerdown', 'pointerup']) at(type, 1, 100);
        focus = realFocus;
        const axis = camera.r[2];
        for (const id of [1, 2, 3]) at('pointerdown', id, 50 * id);
        for (const id of [1, 2, 3]) at('pointermove', id, 50 * id + 20);
        for (const id of [1, 2, 3]) at('pointerup', id, 50 * id + 20);
        delete picture.setPointerCapture;
        tapped = was;
        return [...seen, Math.max(...add(axis, camera.r[2], -1).map(Math.abs))];""")
    page.check('a tap of two fingers is no double tap', asked[0] == 0, asked)
    page.check('two taps are one', asked[1] == 1, asked)
    page.check('three fingers do not turn the camera', asked[2] < 1e-12, asked)
    page.js('keys.h()')
    time.sleep(0.6)
    page.settle()


# What opened paths changed is as it was: keyframes, seconds and background as `before`, `long` and
# `looked`.
RESTORED = """
          keyframes = before;
          $('seconds').value = long;
          $('background').value = looked;
          resetCrop();
          listKeys();
          keys.h();
          done(all);"""


def open_paths(page):
    """A file's box, background and ends are the page's; broken ones and too many are refused."""
    got = page.later("""
        const open = (read) => openPath({name: 'path', text: async () => JSON.stringify(read)});
        const shown = () => [$('background').value, isCropped()], all = [];
        const before = keyframes, looked = $('background').value, long = $('seconds').value;
        (async () => {
          const views = keyframes.map((c) => ({matrix: toNerfstudio(c), fov: 50}));
          await open({keyframes: views, crop: {crop_center: cropMiddle(), crop_scale: [1, 1, 1],
            crop_bg_color: {r: 16, g: 32, b: 255}}});
          all.push(shown());
          await open({keyframes: views, crop: null});
          all.push(shown());
          const kept = keyframes, broken = [{crop_center: [0, 'x', 0], crop_scale: [1, 1, 1]},
            {crop_center: [0, 0, 0], crop_scale: [1, 0, 1]}, {crop_center: [0, 0, 0]},
            {crop_center: [0, 0, 0], crop_scale: [1, 1, 1], crop_bg_color: {r: 'red'}},
            {crop_center: [0, 0, 0], crop_scale: [1, 1, 1], crop_bg_color: [255, 0, 0]},
            {crop_center: [0, 0, 0], crop_scale: [1, 1, 1], crop_bg_color: 'white'}];
          const refused = [];
          for (const crop of broken) {
            say('');
            await open({keyframes: views, seconds: 99, crop});
            refused.push(keyframes === kept && $('seconds').value === long && !isCropped() &&
              /not a camera path: its crop_/.test($('message').textContent));
          }
          all.push(refused);
          const poses = Array.from({length: 120}, (_, i) => ({...copy(home), p: [i, 0, 0]}));
          await open({camera_path: poses.map((c) => ({camera_to_world: toNerfstudio(c),
            fov: 50}))});
          all.push(keyframes.length, keyframes[0].p[0], keyframes[keyframes.length - 1].p[0]);
          const frames = framesOfPath().length, said = $('message').textContent;
          $('seconds').value = 3600;
          $('fps').value = 120;
          all.push(framesOfPath(), $('message').textContent);
          $('seconds').value = 301;
          $('fps').value = 24;
          await makeFilm();
          all.push($('message').textContent);
          all.push(frames, said);
""" + RESTORED + """
        })().catch((error) => done([[], [], [], 0, 0, 0, 0, String(error), '']));""")
    page.check("a file's box comes with its background", got[0] == ['#1020ff', True], got[0])
    page.check('without a box in the file there is none', got[1:2] == [['#1020ff', False]], got[1])
    page.check('a file with a broken box changes nothing', got[2] == 6 * [True], got[2])
    page.check('of 120 poses 50 are taken, from the first to the last', got[3:6] == [50, 0, 119],
               got[3:6])
    page.check('and the path has as many frames as the file, which is told',
               got[9] == 120 and '120 views' in got[10] and '50 of them' in got[10], got[9:])
    page.check('more frames than can be rendered are refused, with the number',
               got[6] is None and '432,000' in got[7] and '100,000' in got[7], got[7])
    page.check('a film of too many is refused, with the number',
               '7,224' in got[8] and '7,200' in got[8], got[8])
    time.sleep(0.6)
    page.settle()


def open_foreign(page):
    """A path in nerfstudio's frame comes to the scene's by the file of that frame, box and all."""
    got = page.later("""
        const file = (name, read) => ({name, text: async () => JSON.stringify(read)});
        const before = keyframes, looked = $('background').value, long = $('seconds').value;
        const own = facts.applied, wanted = before.map(toPose), all = [];
        /* p' = s (R p + t), of poses that ns-process-data had made of p: q = k (A p + a) */
        const spin = (v, back) => back ? turn(turn(v, [0, 0, 1], -0.5), [1, 0, 0], -2) :
          turn(turn(v, [1, 0, 0], 2), [0, 0, 1], 0.5);
        const columns = [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map((v) => spin(v));
        const t = [0.3, -2, 5], s = 0.25, k = 1.5, a = [1, 2, -3];
        const A = (v, back) => turn(v, [0, 1, 0], back ? -1 : 1);
        const data = {transform: [0, 1, 2].map((i) => [...columns.map((c) => c[i]), t[i]]),
          scale: s};
        facts.applied = {known: true, scale: k, transform: [0, 1, 2].map((i) =>
          [...[[1, 0, 0], [0, 1, 0], [0, 0, 1]].map((v) => A(v)[i]), a[i]])};
        const place = (p) => spin(A(add(p, a, -1), true)).map((v, i) => (v + t[i]) * s / k);
        const theirs = before.map((c) => ({...copy(c), p: place(c.p),
          r: c.r.map((v) => spin(A(v, true)))}));
        const degrees = [20, -35, 70], sides = [-0.4, -0.3, -0.2, 0.1, 0.5, 0.6];
        const axes = axesOfTurn(degrees).map((v) => spin(A(v, true)));
        const middle = place([0, 1, 2].map((i) => (sides[i] + sides[i + 3]) / 2));
        const path = {keyframes: theirs.map((c) => ({matrix: toNerfstudio(c), fov: 50})),
          crop: {crop_center: middle, crop_scale: [0, 1, 2].map((i) => (sides[i + 3] - sides[i]) *
            s / k), crop_rot: turnOfAxes(axes).map((v) => v * Math.PI / 180)}};
        const most = (x, y) => Math.max(...x.map((v, i) => Math.abs(v - y[i])));
        const off = () => Math.max(...keyframes.map((c, i) => most(toPose(c), wanted[i])));
        const straight = straighten;
        straighten = () => {};
        (async () => {
          say('');
          await openPath(file('camera_path.json', path));
          all.push(off(), $('message').textContent);
          say('');
          openFiles([file('dataparser_transforms.json', data), file('camera_path.json', path)]);
          await new Promise((go) => setTimeout(go, 200));
          all.push(off(), $('message').textContent, most(cropTurn, degrees), most(cropSides(),
            [...sides, ...degrees]));
          await openPath(file('camera_path.json', {...path, poses_in: 'scene'}));
          all.push($('message').textContent);
          await openPath(file('camera_path.json', path), file('x', {transform: [[1]], scale: 1}));
          all.push($('message').textContent);
          openFiles([file('a', path), file('b', path)]);
          all.push($('message').textContent);
          straighten = straight;
          facts.applied = own;
""" + RESTORED + """
        })().catch((error) => done([String(error), '', 0, '', 0, 0, '', '', '']));""")
    page.check("nerfstudio's path alone is elsewhere, which is told",
               got[0] > 0.1 and 'dataparser_transforms.json' in got[1], got[:2])
    page.check('with its frame it is where it was', got[2] < 1e-9 and got[3] == '', got[2:4])
    page.check('and so is its box', got[4] < 1e-6 and got[5] < 1e-6, got[4:6])
    page.check("nothing is told of a path in the scene's frame", got[6] == '', got[6])
    page.check('a broken frame changes nothing', 'has no transform' in got[7], got[7])
    page.check('two paths are refused', 'Open one camera path' in got[8], got[8])
    time.sleep(0.6)
    page.settle()


HIDE = 'Object.defineProperty(document, "hidden", {value: true, configurable: true});'
SHOW = 'delete document.hidden; document.dispatchEvent(new Event("visibilitychange"));'


def be_quiet(page):
    """In a hidden tab there are no requests, and messages stay until they are read."""
    page.js(HIDE + 'touch(true)')
    time.sleep(1)
    page.check('hidden, it asks for no picture', page.js('return last.version < version'))
    page.js(SHOW)
    page.check('shown again, it asks for one', wait_for(page, 'last.version === version'))
    said = page.later("""
        say('No screenshot: a disk is full.');
        touch(true);
        const look = () => last.version < version ? setTimeout(look, 20) :
          done($('message').textContent);
        look();""")
    page.check('a message outlives the next picture', said.startswith('No screenshot'), said)
    page.check('it goes when it has been read', wait_for(page, '!$("message").textContent', 15))
    page.check('nothing is newer', page.js('return $("newer").textContent') == '')
    page.js("""
        window.realFetch = fetch;
        fetch = (path, ...more) => path === 'newest' ? Promise.resolve(new Response(
          '{"newer": 700}')) : realFetch(path, ...more)""")
    page.check('it tells of a newer model', wait_for(
        page, '$("newer").textContent.includes("step 700")', 15))
    page.js("""
        fetch = (path, ...more) => path === 'newest' ? Promise.resolve(new Response(
          '{"newer": null, "gone": true}')) : realFetch(path, ...more)""")
    page.check('and that the run is gone', wait_for(
        page, '$("newer").textContent.includes("no longer in its folder")', 15))
    page.js('fetch = realFetch')
    page.settle()


def listen(page):
    asked = set()
    for entry in page.call('/se/log', {'type': 'performance'}):
        message = json.loads(entry['message'])['message']
        if message['method'] == 'Network.requestWillBeSent':
            asked.add(message['params']['request']['url'])
    page.check('the page requests pictures', any('/picture?' in url for url in asked))
    away = [url for url in asked if not url.startswith((ADDRESS, 'data:', 'blob:'))]
    page.check('no other site is asked', not away, away)
    said = [entry for entry in page.call('/se/log', {'type': 'browser'})
            if entry['level'] in ('WARNING', 'SEVERE')]
    page.check('the console has no errors', not said, said)


def by_keys(page):
    """Every control is reached by Tab, in a circle; Enter and Space use it."""
    page.js('openPanel(true); for (const d of document.querySelectorAll("details")) d.open = true;'
            'document.activeElement.blur()')
    seen = []
    for _ in range(200):
        page.key(KEYS['tab'])
        seen.append(page.js('const e = document.activeElement; return e.id || e.tagName + '
                            '(e.textContent || e.getAttribute("aria-label") || "").slice(0, 20)'))
        if seen[-1] in seen[:-1]:
            break
    wanted = {'picture', 'menu', 'show', 'background', 'fov', 'size', 'home', 'level',
              'save-picture', 'crop', 'crop-0', 'crop-turn-2', 'crop-reset', 'frusta', 'add-key',
              'play', 'seconds', 'fps', 'cycle', 'save-path', 'save-transforms', 'open-path',
              'film-size', 'make-film'}
    page.check('Tab reaches every control', wanted <= set(seen), wanted - set(seen))
    page.check('Tab returns to the start', seen[-1] in seen[:2] and len(seen) > 40, seen[-1])
    unnamed = page.js("""
        const all = document.querySelectorAll('button, input, select, a[href], summary');
        const named = (e) => e.textContent.trim() || e.getAttribute('aria-label') ||
          (e.labels && e.labels.length && e.labels[0].textContent.trim());
        return [...all].filter((e) => e.offsetParent && !named(e)).map((e) => e.id)""")
    page.check('all controls have names', not unnamed, unnamed)
    page.js('$("cameras").querySelector("button").focus()')
    page.key(KEYS['enter'])
    page.check('Enter goes to a camera', wait_for(page, 'at === 0'))
    page.settle()
    page.js('$("frusta").focus()')
    before = page.js('return $("frusta").checked')
    page.key(' ')
    page.check('Space ticks a box', page.js('return $("frusta").checked') != before)
    page.key(' ')
    page.js('for (const d of document.querySelectorAll("details")) d.open = false;'
            '$("cameras-part").open = true; $("menu").focus()')
    page.key(KEYS['enter'])
    page.check('Enter closes the panel',
               page.js('return document.body.classList.contains("closed")'))
    page.key(KEYS['enter'])
    page.js('$("show").focus()')
    page.key(KEYS['escape'])
    page.check('Escape returns to the picture',
               page.js('return document.activeElement === picture'))
    page.js('$("frusta").focus()')
    page.key('m')
    page.check('a panel that is closed gives the focus to its button',
               page.js('return document.activeElement.id') == 'menu')
    page.key('m')
    page.js('$("path-part").open = true')
    page.key('k', 'k', 'k')
    for row, column, what, wanted in ((1, 1, 'View 2 earlier', 'View 1 earlier'),
                                      (2, 3, 'Remove view 3', 'Remove view 2'),
                                      (0, 3, 'Remove view 1', 'Remove view 1'),
                                      (0, 3, 'Remove view 1', 'Add this view')):
        page.js('$("keys-list").children[arguments[0]].children[arguments[1]].focus()', row, column)
        page.key(KEYS['enter'])
        got = page.js('const e = document.activeElement;'
                      'return e.getAttribute("aria-label") || e.textContent')
        page.check(f'after {what} the focus is there', got == wanted, got)
    page.js('document.activeElement.blur()')
    page.key('h')
    time.sleep(0.6)
    page.settle()


def look_of(page, dark, phone):
    """Readable: nothing wider than the window, contrast, and large enough for a finger."""
    page.check('nothing is wider than the window', page.js(
        'return document.documentElement.scrollWidth <= innerWidth && '
        '$("panel").scrollWidth <= $("panel").clientWidth'))
    back, text, soft = page.js("""
        const s = getComputedStyle(document.body), rgb = (t) => t.match(/[0-9.]+/g).map(Number);
        const soft = getComputedStyle(document.querySelector('.soft')).color;
        return [rgb(s.backgroundColor), rgb(s.color), rgb(soft)];""")

    def light(colour):
        parts = [v / 255 for v in colour[:3]]
        parts = [v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in parts]
        return 0.2126 * parts[0] + 0.7152 * parts[1] + 0.0722 * parts[2]

    def contrast(a, b):
        low, high = sorted((light(a), light(b)))
        return (high + 0.05) / (low + 0.05)
    page.check('it is dark if the system is', (light(back) < 0.1) == dark, back)
    edge = page.js('return getComputedStyle($("show")).borderTopColor.match(/[0-9]+/g).map(Number)')
    page.check('edges of controls have contrast', contrast(back, edge) > 3, contrast(back, edge))
    page.check('its text has contrast', contrast(back, text) > 7 and contrast(back, soft) > 4.5,
               [contrast(back, text), contrast(back, soft)])
    if phone:
        small = page.js("""
            return [...document.querySelectorAll('button')].filter((b) => b.offsetParent &&
              b.getBoundingClientRect().height < 30).map((b) => b.textContent)""")
        page.check('buttons are large enough for a finger', not small, small)


def two_at_once(driver):
    """Another viewer's camera moves; this one gets its own pictures, and stays."""
    one, other = Page(driver, 'one', 700, 500), Page(driver, 'other', 500, 700, dark=True)
    first = one.js(MEAN)
    at, shown = one.pose(), one.js('return last.version')
    for _ in range(3):
        other.key(KEYS['left'], KEYS['up'])
        one.key('2', '1')
        time.sleep(0.3)
    other.settle()
    one.settle()
    other.check('two at once: the other turns', moved(at, other.pose()) > 0.1)
    one.check('two at once: this one stays', moved(at, one.pose()) < 1e-12)
    one.check('two at once: it gets its own pictures', one.js('return last.version') > shown and
              abs(one.js(MEAN) - first) < 0.5 and abs(other.js(MEAN) - first) > 0.5,
              [first, one.js(MEAN), other.js(MEAN)])
    for page in (one, other):
        listen(page)
        page.close()


def wait_for(page, script, seconds=30):
    end = time.time() + seconds
    while time.time() < end:
        if page.js('return ' + script):
            return True
        time.sleep(0.1)
    return False


def steer(page, last):
    page.js('openPanel(true)')
    page.check('it shows the progress', wait_for(page, 'training && training.step > 0'))
    page.check('it shows a curve', wait_for(page, 'document.querySelector("#curve polyline")'))
    step = page.js('return last.step')
    page.check('the picture follows the training', wait_for(page, f'last.step > {step}'))
    page.shot('training')
    page.js(HIDE)
    time.sleep(2)  # requests under way are answered
    steps = page.js('return [training.step, last.step]')
    time.sleep(2)
    page.check('hidden, it asks for nothing', page.js('return [training.step, last.step]') == steps)
    page.js(SHOW)
    page.check('shown again, it follows', wait_for(page, f'last.step > {steps[1]}'))
    page.js('$("pause").click()')
    page.check('a button pauses', wait_for(page, 'training.state === "paused"'))
    page.settle()
    page.check('the button then continues', page.js('return $("pause").textContent') == 'Continue')
    page.js('$("checkpoint").click()')
    page.check('a button saves', wait_for(page, 'training.saved_step === training.step'))
    page.js('$("stages").parentNode.open = true')
    page.shot('paused')
    page.js('$("pause").click()')
    page.check('the button continues', wait_for(page, 'training.state === "training"'))
    if last:
        page.js('$("stop").click()')
        page.check('stopping asks for confirmation',
                   page.js('return $("stop").textContent') == 'Really stop?')
        page.js('$("stop").click()')
        page.check('it shows the end', wait_for(page, 'ended'))
        page.shot('ended')
        outlive(page)


def outlive(page):
    """Another viewer gets the address of one that has ended: the page stays that of the former."""
    before = page.js('return [document.title, last.step, $("title").textContent]')
    port = ADDRESS.rstrip('/').split(':')[2]
    viewer = subprocess.Popen(NEXT + ['--port', port], stdout=subprocess.DEVNULL,
                              stderr=subprocess.DEVNULL)
    page.check('a page notes that its address is another viewer\'s', wait_for(page, 'left', 60))
    page.check('and says what to do', 'Reload the page' in
               page.js('return $("message").textContent'))
    page.js('touch(true)')
    time.sleep(2)
    page.check('it stays what it was', before ==
               page.js('return [document.title, last.step, $("title").textContent]'))
    page.check('its buttons are off', page.js('return $("stop").disabled && $("pause").disabled'))
    page.shot('left')
    viewer.terminate()
    viewer.wait()


def watch(driver):
    for name, width, height, dark, phone in (('training-dark', 1000, 700, True, False),
                                             ('training-phone', 390, 780, False, True),
                                             ('training', 1200, 800, False, False)):
        page = Page(driver, name, width, height, dark, phone)
        steer(page, name == 'training')
        if name != 'training':  # its last requests fail
            listen(page)
        page.close()


def read_documents(driver):
    """On a phone, report and check's page are no wider than the screen: wide tables scroll alone.

    Such a browser shows a page that is too wide smaller, so innerWidth tells nothing."""
    width = 400
    for name in ('report', 'check'):
        page = Page(driver, name, width, 800, phone=True, document=name + '.html')
        page.check('it has tables', page.js('return document.querySelectorAll("table").length') > 0)
        page.check(f'at {width} pixels nothing runs off the page',
                   page.js('return document.documentElement.scrollWidth') <= width,
                   page.js("""
                       return [...document.querySelectorAll('body *')].filter((e) =>
                         e.getBoundingClientRect().right > arguments[0] + 1).slice(0, 5).map((e) =>
                         e.tagName + ' ' + e.textContent.slice(0, 40))""", width))
        page.shot('phone')
        page.close()


def main():
    driver = Driver()
    if RENDERED == 'documents':
        try:
            read_documents(driver)
        finally:
            driver.process.terminate()
        return
    if RENDERED == 'training':
        try:
            watch(driver)
        finally:
            driver.process.terminate()
        return
    try:
        for name, width, height, dark, phone in (('desktop', 1200, 800, False, False),
                                                 ('dark', 1000, 700, True, False),
                                                 ('phone', 390, 780, False, True)):
            if name not in PAGES.split():
                continue
            page = Page(driver, name, width, height, dark, phone)
            page.shot('start')
            look_of(page, dark, phone)
            look_around(page)
            if name == 'desktop':
                by_keys(page)
            see_cameras(page)
            make_path(page)
            make_film(page)
            come_back(page)
            stop_path(page)
            fly_on(page)
            tap(page)
            open_paths(page)
            open_foreign(page)
            be_quiet(page)
            crop(page)
            listen(page)
            page.close()
        if 'two' in PAGES.split():
            two_at_once(driver)
    finally:
        driver.process.terminate()


main()
