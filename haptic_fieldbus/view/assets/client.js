// The pictures of the live view. Rows come through a WebSocket as doubles; each picture that is drawn is acknowledged,
// and the server sends no more before. Commands go the same way back, so that the server knows which page steers.
"use strict";

window.haptic = (() => {
  const KEPT = 12; // seconds of rows that are kept
  const SILENT = 500; // ms without a row after which the page says that it is not alive
  const RETRY = 250; // ms
  const MM = 1000, DEGREES = 180 / Math.PI;
  const ARROWS = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1 };
  let hello = null, first = {}, steers = false, socket = null, ended = null, paused = false;
  let rows = [], places = {}; // rows as Float64Array, oldest first; places of the columns by name
  let next = -1, lastRow = 0, frames = [], held = null, shown = 5, changed = true, speed = 1;
  let waiting = []; // the changes that are accepted and have not begun
  let mouse = null, marks = [], dragged = null;
  let stopping = false; // STOP was pressed, and is sent again when a lost connection is back
  const trigger = { column: null, level: NaN, before: NaN, at: null }; // holds the charts when a column crosses a level
  const limits = {}; // scales of charts, which grow at once and shrink slowly
  const drawn = {}; // what was drawn last, for tests and the curious

  const $ = (id) => document.getElementById(id);
  const css = (name) => getComputedStyle(document.body).getPropertyValue(name).trim();
  let colours = {};
  const readColours = () => {
    for (const name of ["card", "ink", "faint", "line", "blue", "orange", "green", "red", "purple", "grey"])
      colours[name] = css("--" + name);
  };

  // The connection.

  function connect() {
    if (ended) return;
    socket = new WebSocket(`ws://${location.host}/stream?client=${window.hapticClient}`);
    socket.binaryType = "arraybuffer";
    socket.onmessage = (event) => (typeof event.data === "string" ? told(JSON.parse(event.data)) : take(event.data));
    socket.onclose = () => { alive(); setTimeout(connect, RETRY); };
  }

  function send(command) {
    if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(command));
  }

  function told(message) {
    if (message.hello || message.hand || message.steers === false) dragged = null; // the hand of this page has let go
    if (message.alive) { send({ alive: 1 }); return; }
    if (message.hello && message.hello.columns) {
      if (hello && hello.run !== message.hello.run) { if (stopping) stop(); hello = null; location.reload(); return; } // another run of this process
      const other = !hello || message.hello.columns.join() !== hello.columns.join();
      hello = message.hello;
      first = message.first || first;
      places = Object.fromEntries(hello.columns.map((name, place) => [name, place]));
      if (other) { rows = []; next = -1; restore(); }
      waiting = (hello.waiting || []).map((each) => ({ ...each, text: changeText(each) }));
      pace(hello);
      if (hello.trip) trip(hello.trip);
    }
    if (message.scene && hello) hello.parameters = message.scene.parameters;
    if (message.pace) pace(message.pace);
    if (message.hello && (stopping || message.hello.process === sessionStorage.getItem("haptic_fieldbus.stop"))) stop();
    if ("steers" in message) role(message.steers);
    if (message.changed) {
      waiting.push({ ...message, text: changeText(message) });
      answer("", "");
    }
    if (message.refused) answer("refused", message.refused);
    if (message.trip) trip(message.trip);
    if (message.ended) finish(message.ended);
    changed = true;
  }

  function take(buffer) {
    const values = new Float64Array(buffer), width = hello ? hello.columns.length : 0;
    if (!width) return;
    const count = (values.length - 2) / width;
    if (values[0] > next + 1) rows = rows.length && values[0] - next < hello.rate ? rows : [];
    for (let at = 0; at < count; at++) {
      rows.push(values.subarray(2 + at * width, 2 + (at + 1) * width));
      if (trigger.column && !held) watch(rows[rows.length - 1]);
    }
    next = values[1];
    const oldest = time(rows[rows.length - 1]) - KEPT;
    let gone = 0;
    while (gone < rows.length && time(rows[gone]) < oldest) gone++;
    if (gone > 200) rows.splice(0, gone);
    lastRow = performance.now();
    changed = true;
    if (document.hidden) send({ ack: 1 }); // nothing is drawn, and the run is still followed
  }

  function watch(row) { // a crossing is held in the middle of the window
    const now = value(row, trigger.column) * scaled(trigger.column)[1], { before, level } = trigger;
    if (trigger.at === null && before < level !== now < level && Number.isFinite(before + now + level)) trigger.at = time(row);
    trigger.before = now;
    if (trigger.at !== null && time(row) >= trigger.at + shown / 2) { const { at } = trigger; hold(); marks = [at]; }
  }
  function arm(what) {
    Object.assign(trigger, what, { before: NaN, at: null });
    if (!(trigger.column in places)) trigger.column = null;
    changed = true;
  }

  function alive() {
    const open = socket && socket.readyState === WebSocket.OPEN;
    const wait = Math.max(SILENT, hello ? 3e3 / (hello.rate * speed) : 0); // in slow motion rows are rare
    const silent = performance.now() - lastRow > wait && !paused && rows.length;
    const lost = !ended && (!open || silent);
    document.body.classList.toggle("lost", Boolean(lost));
    document.body.classList.toggle("over", Boolean(ended));
    $("lost").hidden = !lost && !ended;
    if (ended) $("lost").textContent = `The run has ended${ended.text && $("trip").hidden ? ": " + ended.text : "."}`;
    else if (lost) $("lost").textContent = open ? `No data for ${short(1e-3 * wait)} s. What is shown is old.`
      : `Connection lost. What is shown is old; the run may go on. Stop it at its terminal with Ctrl-C.${stopping ? " STOP is sent again when the connection is back." : ""}`;
  }

  // Words.

  const changeText = ({ changed: made }) => Object.entries(made).map(([name, value]) => `${name} = ${short(value)}`).join(", ");
  const short = (value) => Number(value.toPrecision(4)).toString();
  function answer(kind, text) { const place = $("answer"); if (place) { place.className = kind; place.textContent = text; } }
  function trip(text) { $("trip").hidden = false; $("trip").textContent = text; }
  function finish(told) { // the last rows of a trip come after its words, so the charts are held at the end of the run
    ended = told; alive(); $("stop").disabled = true;
    window.socket?.io.reconnection(false); // that of NiceGUI: nobody is there any more
    if (!$("trip").hidden && told.text) trip(told.text); // it says whether the drives have confirmed that they are off
    if (!$("trip").hidden && !held) { hold(); held = rows; }
  }
  function pace(told) { paused = told.paused; speed = told.speed; lastRow = performance.now(); document.body.classList.toggle("paused", Boolean(paused)); }
  function role(mine) {
    steers = mine;
    const place = $("role");
    place.replaceChildren();
    if (mine) return;
    const button = document.createElement("button");
    button.textContent = "Steer from this page";
    button.onclick = () => send({ steer: 1 });
    place.append("Another page steers; this one looks, and can stop. ", button);
  }

  // Rows.

  const time = (row) => row[places.t_ns] * 1e-9;
  const value = (row, name) => row[places[name]];
  function after(all, at) { // number of the first row that is not before a time
    let low = 0, high = all.length;
    while (low < high) { const middle = (low + high) >> 1; if (time(all[middle]) < at) low = middle + 1; else high = middle; }
    return low;
  }
  const newest = () => rows[rows.length - 1];
  const last = () => (held || rows)[(held || rows).length - 1];
  function unit(name) { return (hello.units && hello.units[name]) || ""; }
  function scaled(name) { // the unit in which a column is shown, and its factor
    const found = unit(name);
    return found === "m" ? ["mm", MM] : found === "rad" ? ["°", DEGREES] : [found, 1];
  }
  const error = (axis) => (row) => value(row, axis + ".command") - value(row, axis + ".force");

  // Commands of the controls.

  function change(name, to) { // a text that is no number is refused by the run, and the field goes back
    const number = String(to).trim() === "" ? NaN : Number(to), asked = Number.isFinite(number) ? number : String(to);
    answer("", `${name} = ${asked} is being checked …`);
    send({ change: { [name]: asked } });
  }
  function meant(name, to) { answer("", `${name} = ${short(to)}; it is checked at release`); }
  function reset() {
    const other = hello.parameters.filter((each) => !each.fixed && each.value !== first[each.name]);
    if (other.length) send({ change: Object.fromEntries(other.map((each) => [each.name, first[each.name]])) });
    else answer("", "These are the values of the file.");
  }
  function stop() {
    stopping = true;
    send({ stop: 1 });
    // NiceGUI loads the page anew for another server, which may be sooner than this connection is back.
    if (hello) sessionStorage.setItem("haptic_fieldbus.stop", hello.process);
  }
  function scene(name) { answer("", `${name} is being checked …`); send({ scene: name }); }
  function pause() { send({ paused: !paused }); }
  function step() { send({ paused: true, steps: 1 }); }
  function hold() { held = held ? null : rows.slice(); marks = []; arm({}); const place = $("hold"); if (place) place.classList.toggle("held", Boolean(held)); }
  function span(seconds) { shown = seconds; store("span", seconds); changed = true; }
  function theme() { Quasar.Dark.toggle(); store("dark", Quasar.Dark.isActive); setTimeout(restyle, 0); }
  function restyle() { readColours(); changed = true; }
  function columns(chart, names) { charts[chart] = names; store("columns", charts); changed = true; }
  function copy() {
    if (hello.command.includes(" --from")) { answer("", "A repeated run takes no other values on its command line."); return; }
    const set = hello.parameters.filter((each) => each.value !== first[each.name]).map((each) => `--set ${each.name}=${each.value}`);
    const line = [hello.command, ...set].join(" ");
    const copied = navigator.clipboard ? navigator.clipboard.writeText(line) : Promise.reject(); // not there on another computer, without TLS
    copied.then(() => answer("made", `copied: ${line}`), () => answer("", line));
  }

  const charts = { position: [], force: [], error: [] };
  function store(key, what) { localStorage.setItem("haptic_fieldbus." + key, JSON.stringify(what)); }
  function restore() {
    const read = (key) => JSON.parse(localStorage.getItem("haptic_fieldbus." + key) || "null");
    if (read("dark") !== null && window.Quasar) Quasar.Dark.set(read("dark"));
    shown = read("span") || shown;
    for (const [name, chosen] of Object.entries(read("columns") || {}))
      charts[name] = chosen.filter((column) => column in places);
    setTimeout(restyle, 0);
  }

  function save(blob, name) {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(blob);
    link.download = name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  }
  function visible() { const all = held || rows; return all.length ? all.slice(after(all, time(last()) - shown)) : []; }
  function saveCsv() {
    const text = [hello.columns.join(","), ...visible().map((row) => Array.from(row).join(","))].join("\n") + "\n";
    save(new Blob([text], { type: "text/csv" }), `${hello.scene}.csv`);
  }
  function savePng() {
    const all = [...document.querySelectorAll("canvas[data-kind]")], box = document.querySelector(".pictures").getBoundingClientRect();
    const sheet = document.createElement("canvas"), ratio = devicePixelRatio, pen = sheet.getContext("2d");
    sheet.width = box.width * ratio; sheet.height = box.height * ratio;
    pen.fillStyle = css("--ground"); pen.fillRect(0, 0, sheet.width, sheet.height);
    for (const each of all) { const at = each.getBoundingClientRect(); pen.drawImage(each, (at.x - box.x) * ratio, (at.y - box.y) * ratio); }
    sheet.toBlob((blob) => save(blob, `${hello.scene}.png`));
  }

  // Drawing.

  function begin(canvas) { // clear a canvas in the pixels of the screen; sizes below are in those of CSS
    const ratio = devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.fillStyle = colours.card;
    pen.fillRect(0, 0, width, height);
    pen.font = "12px system-ui, sans-serif";
    pen.lineJoin = "round";
    return [pen, width, height];
  }
  function words(pen, text, x, y, colour = colours.faint, align = "left") { pen.fillStyle = colour; pen.textAlign = align; pen.fillText(text, x, y); }
  function ticks(low, high, most) { // round numbers between two ends, at least two: one alone is no scale
    const rough = (high - low) / most, power = 10 ** Math.floor(Math.log10(rough)), round = [0.5, 1, 2, 5, 10];
    const found = [], at = round.findIndex((each) => each === 10 || each * power >= rough);
    for (let place = at; place >= at - 1 && found.length < 2; place--) {
      const step = round[place] * power;
      found.length = 0;
      for (let number = Math.ceil(low / step); number <= high / step + 1e-9; number++) found.push(Number((number * step).toPrecision(12)));
    }
    return found;
  }
  function scale(key, low, high, least) { // the ends of an axis: they grow at once and shrink in a second, so that nothing jumps
    const room = Math.max(0.08 * (high - low), 0.5 * (least - (high - low))), wanted = [low - room, high + room], now = performance.now();
    const [before, at] = limits[key] || [wanted, now], share = 1 - Math.exp((at - now) / 500);
    const ends = [Math.min(wanted[0], before[0] + share * (wanted[0] - before[0])), Math.max(wanted[1], before[1] + share * (wanted[1] - before[1]))];
    limits[key] = [ends, now];
    return ends;
  }
  function line(pen, points, colour, width = 1.6, dash = []) {
    pen.beginPath();
    let down = false;
    for (const [x, y] of points) {
      if (!Number.isFinite(y)) { down = false; continue; }
      if (down) pen.lineTo(x, y); else pen.moveTo(x, y);
      down = true;
    }
    pen.strokeStyle = colour; pen.lineWidth = width; pen.setLineDash(dash); pen.stroke(); pen.setLineDash([]);
  }
  function arrow(pen, x, y, dx, dy, colour, filled) {
    const size = Math.hypot(dx, dy);
    if (size < 2) return;
    const [ux, uy] = [dx / size, dy / size], head = Math.min(11, size);
    line(pen, [[x, y], [x + dx - ux * head * 0.7, y + dy - uy * head * 0.7]], colour, filled ? 5 : 2);
    pen.beginPath();
    pen.moveTo(x + dx, y + dy);
    pen.lineTo(x + dx - ux * head - uy * head * 0.6, y + dy - uy * head + ux * head * 0.6);
    pen.lineTo(x + dx - ux * head + uy * head * 0.6, y + dy - uy * head - ux * head * 0.6);
    pen.closePath(); pen.fillStyle = pen.strokeStyle = colour; pen.lineWidth = 1.5;
    if (filled) pen.fill(); else pen.stroke();
  }
  const mix = (force, axis) => { // colour of a place: how strongly the scene pushes there
    const share = Math.min(1, Math.abs(force) / axis.effort);
    return share < 1e-3 ? null : [force < 0 ? colours.orange : colours.blue, 0.12 + 0.5 * share];
  };

  function handle(canvas, axis) {
    const [pen, width, height] = begin(canvas), row = newest();
    const [shownUnit, factor] = axis.rotary ? ["°", DEGREES] : ["mm", MM];
    words(pen, `${axis.name} [${shownUnit}]` + (axis.partner ? ` – coupled to ${axis.partner}` : ""), 12, 18, colours.ink);
    words(pen, axis.drive, width - 12, 18, colours.faint, "right");
    const position = row ? value(row, axis.name + ".position") : 0;
    const asked = row ? value(row, axis.name + ".force") : 0, given = row ? value(row, axis.name + ".command") : 0;
    (axis.rotary ? dial : track)(pen, width, height, axis, position, asked, given);
    words(pen, `${(position * factor).toFixed(2)} ${shownUnit}`, 12, height - 10, colours.ink);
    const said = [`asked ${asked.toFixed(axis.rotary ? 4 : 2)}`, `given ${given.toFixed(axis.rotary ? 4 : 2)} ${axis.effort_unit}`];
    if (axis.rotary && width < 560) said.forEach((text, number) => words(pen, text, width - 12, height - 26 + 16 * number, colours.ink, "right"));
    else words(pen, said.join(", "), width - 12, height - 10, colours.ink, "right");
    drawn[axis.name] = { position, asked, given, t_ns: row ? row[places.t_ns] : 0, x: canvas.placeOf ? canvas.placeOf(position) : null };
  }

  function track(pen, width, height, axis, position, asked, given) {
    const [low, high] = axis.travel, left = 30, right = width - 30, base = height - 62, top = 62;
    const x = (place) => left + ((place - low) / (high - low)) * (right - left);
    const canvas = pen.canvas;
    canvas.placeOf = x;
    canvas.placeAt = (at) => low + ((at - left) / (right - left)) * (high - low);
    const law = axis.law;
    for (let across = Math.round(left); across < right; across++) {
      const force = law[Math.round(((across - left) / (right - left)) * (law.length - 1))], colour = force === null ? null : mix(force, axis);
      if (!colour) continue;
      pen.globalAlpha = colour[1]; pen.fillStyle = colour[0];
      pen.fillRect(across, top, 1, base - top);
    }
    pen.globalAlpha = 1;
    line(pen, [[left, base], [right, base]], colours.grey, 2);
    for (const place of ticks(low * MM, high * MM, width / 70)) {
      const at = x(place / MM);
      line(pen, [[at, base], [at, base + 5]], colours.grey, 1);
      words(pen, String(place), at, base + 17, colours.faint, "center");
    }
    const at = x(position), middle = (top + base) / 2;
    if (dragged && dragged.axis === axis.name) spring(pen, at, middle, x(dragged.target), middle);
    pen.fillStyle = colours.blue; pen.strokeStyle = colours.card; pen.lineWidth = 2;
    pen.beginPath(); pen.roundRect(at - 9, top + 10, 18, base - top - 11, 5); pen.fill(); pen.stroke();
    line(pen, [[at, top + 3], [at, base]], colours.ink, 1.5);
    for (const each of axis.surfaces) surface(pen, x(each.at), top, base, each);
    const reach = (0.35 * (right - left)) / felt(axis, asked, given);
    for (const [effort, y, colour, filled] of [[asked, top - 22, colours.orange, false], [given, top - 8, colours.green, true]]) {
      arrow(pen, at, y, effort * reach, 0, colour, filled);
      if (!(Math.abs(effort * reach) >= 2)) continue;
      const text = `${short(effort)} ${axis.effort_unit}`, way = Math.sign(effort), head = at + effort * reach + 6 * way;
      const end = head + way * pen.measureText(text).width, fits = end > 6 && end < width - 6; // else it stands behind the arrow
      words(pen, text, fits ? head : at - 8 * way, y + 4, colour, way > 0 === fits ? "left" : "right");
    }
  }

  function felt(axis, ...now) { // the largest force of the time that is shown, of which arrows are parts
    const all = held || rows, forces = now.map(Math.abs);
    for (let at = all.length ? after(all, time(last()) - shown) : 0; at < all.length; at += 10)
      forces.push(Math.abs(value(all[at], axis.name + ".force")), Math.abs(value(all[at], axis.name + ".command")));
    return scale("felt " + axis.name, 0, Math.max(0.01 * axis.effort, ...forces.filter(Number.isFinite)), 0)[1];
  }

  function surface(pen, x, top, bottom, each) { // an edge with hatching on the side of its material
    const side = each.side === "negative" ? -1 : 1;
    line(pen, [[x, top], [x, bottom]], colours.ink, 2.5);
    for (let y = top + 4; y < bottom; y += 9) line(pen, [[x, y + 6], [x + 9 * side, y]], colours.ink, 1.2);
    words(pen, each.name, x, bottom + 31, colours.ink, "center");
  }

  function spring(pen, x0, y0, x1, y1) {
    const points = [[x0, y0]], turns = 9;
    for (let number = 1; number < turns; number++) {
      const share = number / turns, off = number % 2 ? 6 : -6, angle = Math.atan2(y1 - y0, x1 - x0) + Math.PI / 2;
      points.push([x0 + (x1 - x0) * share + off * Math.cos(angle), y0 + (y1 - y0) * share + off * Math.sin(angle)]);
    }
    line(pen, [...points, [x1, y1]], colours.purple, 2);
    pen.beginPath(); pen.arc(x1, y1, 6, 0, 2 * Math.PI); pen.fillStyle = colours.purple; pen.fill();
  }

  function dial(pen, width, height, axis, position, asked, given) {
    const cx = width / 2, cy = height / 2 + 6, radius = Math.max(8, Math.min(width * 0.4, height * 0.5 - 48)), [low, high] = axis.travel;
    const canvas = pen.canvas, at = (place, far) => [cx + far * Math.sin(place), cy - far * Math.cos(place)];
    canvas.placeOf = (place) => at(place, radius)[0];
    canvas.centre = [cx, cy];
    const law = axis.law, step = (high - low) / (law.length - 1);
    law.forEach((force, number) => {
      const place = low + number * step, colour = force === null ? null : mix(force, axis);
      if (!colour || Math.abs(place - position) > Math.PI) return; // of a longer travel, the turn around the handle
      pen.globalAlpha = colour[1]; pen.strokeStyle = colour[0]; pen.lineWidth = 14;
      pen.beginPath(); pen.arc(cx, cy, radius + 12, place - step - Math.PI / 2, place + step - Math.PI / 2); pen.stroke();
      pen.globalAlpha = 1;
    });
    for (const each of axis.surfaces) if (Math.abs(each.at - position) <= Math.PI) line(pen, [at(each.at, radius + 3), at(each.at, radius + 22)], colours.ink, 2.5);
    for (let degrees = -180; degrees < 180; degrees += 30) {
      line(pen, [at(degrees / DEGREES, radius + 3), at(degrees / DEGREES, radius + (degrees % 90 ? 6 : 10))], colours.grey, 1);
      if (degrees % 90 === 0) words(pen, `${degrees}°`, ...at(degrees / DEGREES, radius + (degrees % 180 ? 38 : 27)).map((each, which) => each + 4 * which), colours.faint, "center");
    }
    pen.beginPath(); pen.arc(cx, cy, radius, 0, 2 * Math.PI); pen.fillStyle = colours.card; pen.strokeStyle = colours.ink; pen.lineWidth = 3; pen.fill(); pen.stroke();
    line(pen, [at(position, radius * 0.35), at(position, radius * 0.92)], colours.ink, 6);
    const most = felt(axis, asked, given);
    for (const [effort, far, colour, wide] of [[asked, 0.62, colours.orange, 2], [given, 0.78, colours.green, 5]]) {
      const turn = (1.2 * effort) / most;
      if (Math.abs(turn) < 0.02) continue;
      pen.beginPath(); pen.arc(cx, cy, radius * far, position - Math.PI / 2, position + turn - Math.PI / 2, turn < 0);
      pen.strokeStyle = colour; pen.lineWidth = wide; pen.stroke();
    }
    if (dragged && dragged.axis === axis.name) spring(pen, ...at(position, radius * 0.8), ...at(dragged.target, radius + 18));
  }

  function law(canvas, axis) {
    const [pen, width, height] = begin(canvas), all = held || rows, row = last();
    const factor = axis.rotary ? DEGREES : MM, [low, high] = axis.travel.map((each) => each * factor);
    const now = all.length ? time(row) : 0, trail = [];
    for (let at = all.length - 1; at >= 0 && time(all[at]) > now - 1.5; at -= 2)
      trail.push([value(all[at], axis.name + ".position") * factor, value(all[at], axis.name + ".command")]);
    const forces = trail.map((each) => each[1]).filter(Number.isFinite), felt = Math.max(0.3 * axis.effort, 1.5 * Math.max(...forces.map(Math.abs), 0));
    const known = axis.law.filter((each) => each !== null && Math.abs(each) <= felt); // of a law that goes far beyond what is felt, that part
    const [bottom, top] = scale("law " + axis.name, Math.min(0, ...known, ...forces), Math.max(0, ...known, ...forces), 0.02 * axis.effort);
    const left = 48, right = width - 14, base = height - 34, ceiling = 30;
    const x = (place) => left + ((place - low) / (high - low)) * (right - left), y = (force) => base - ((force - bottom) / (top - bottom)) * (base - ceiling);
    const title = `${axis.rotary ? "Torque" : "Force"} [${axis.effort_unit}]`, many = hello.axes.length > 1 ? ": " + axis.name : "";
    const fits = [title + " over position" + many, title + many, title].find((each) => pen.measureText(each).width < width - 145) || title;
    words(pen, fits, 12, 18, colours.ink);
    words(pen, axis.rotary ? "°" : "mm", right, height - 6, colours.faint, "right");
    frame(pen, ticks(low, high, width / 80), ticks(bottom, top, height / 45), x, y, [left, right, ceiling, base]);
    pen.save(); pen.beginPath(); pen.rect(left, ceiling, right - left, base - ceiling); pen.clip();
    const step = (high - low) / (axis.law.length - 1);
    line(pen, axis.law.map((force, number) => [x(low + number * step), force === null ? NaN : y(force)]), colours.orange, 2, [6, 4]);
    line(pen, trail.map(([place, force]) => [x(place), y(force)]), colours.green, 1.6);
    if (trail.length) { pen.beginPath(); pen.arc(x(trail[0][0]), y(trail[0][1]), 6, 0, 2 * Math.PI); pen.fillStyle = colours.green; pen.fill(); pen.strokeStyle = colours.card; pen.lineWidth = 2; pen.stroke(); }
    pen.restore();
    key(pen, [...(axis.law[0] === null ? [] : [[axis.whole ? "law" : "static law", colours.orange]]), ["given", colours.green]], right, 18, 12 + pen.measureText(fits).width + 10);
  }

  function frame(pen, across, up, x, y, [left, right, ceiling, base], offset = 0, of = "") {
    for (const place of across) { line(pen, [[x(place), ceiling], [x(place), base]], colours.line, 1); words(pen, short(Number((place - offset).toFixed(9))) + of, x(place), base + 15, colours.faint, "center"); }
    for (const each of up) { line(pen, [[left, y(each)], [right, y(each)]], each === 0 ? colours.grey : colours.line, 1); words(pen, short(each), left - 6, y(each) + 4, colours.faint, "right"); }
  }
  function key(pen, entries, right, y, left) { // names of lines, from the right; of those without room a number
    for (const [number, [name, colour]] of [...entries].reverse().entries()) {
      const wide = pen.measureText(name).width + 19, most = left + (number < entries.length - 1 ? 34 : 0);
      if (right - wide < most) { words(pen, `+ ${entries.length - number}`, right, y, colours.faint, "right"); return; }
      words(pen, name, right, y, colour, "right");
      right -= wide;
      line(pen, [[right, y - 4], [right + 14, y - 4]], colour, 3);
      right -= 10;
    }
  }

  function lines(name) { // [label, unit, colour, function of a row] of each line of a chart
    const palette = [colours.blue, colours.orange, colours.green, colours.purple, colours.red, colours.grey];
    const many = hello.axes.length > 1, named = (axis, text) => (many ? `${axis.name} ${text}`.trim() : text);
    const found = { position: [], force: [], error: [] };
    for (const axis of hello.axes) {
      const [label, factor] = scaled(axis.name + ".position");
      found.position.push([named(axis, "position"), label, (row) => value(row, axis.name + ".position") * factor]);
      found.force.push([named(axis, "asked"), axis.effort_unit, (row) => value(row, axis.name + ".force")], [named(axis, "given"), axis.effort_unit, (row) => value(row, axis.name + ".command")]);
      found.error.push([named(axis, "given − asked"), axis.effort_unit, error(axis.name)]);
    }
    const chosen = charts[name].map((column) => { const [label, factor] = scaled(column); return [column, label, (row) => value(row, column) * factor]; });
    const all = chosen.length ? chosen : found[name], order = name === "force" && !chosen.length ? [1, 2, 3, 4, 5, 0] : [0, 1, 2, 3, 4, 5];
    return all.map(([label, of, read], number) => [label, of, palette[order[number % 6]], read]);
  }

  function chart(canvas, name) {
    const [pen, width, height] = begin(canvas), all = held || rows, end = all.length ? time(last()) : 0;
    const left = 56, right = width - 14, ceiling = 24, base = height - 20;
    const x = (at) => right - ((end - at) / shown) * (right - left);
    const seen = all.slice(after(all, end - shown));
    const each = lines(name), every = Math.max(1, Math.floor(seen.length / (2 * (right - left))));
    const points = each.map(([, , , read]) => thinned(seen, every, read));
    const values = points.flatMap((found) => found.map((point) => point[1])).filter(Number.isFinite);
    const least = Math.min(...values, Infinity), most = Math.max(...values, -Infinity);
    const [bottom, top] = scale(name, Number.isFinite(least) ? least : 0, Number.isFinite(most) ? most : 1, leastOf(each[0][1]));
    const y = (of) => base - ((of - bottom) / (top - bottom)) * (base - ceiling);
    const began = all.length && Number.isFinite(value(last(), "t")) ? end - value(last(), "t") : end;
    frame(pen, ticks(end - shown - began, end - began, width / 90).map((at) => at + began), ticks(bottom, top, (base - ceiling) / 26), x, y, [left, right, ceiling, base], began, " s");
    pen.save(); pen.beginPath(); pen.rect(left, ceiling - 2, right - left, base - ceiling + 4); pen.clip();
    points.forEach((found, number) => line(pen, found.map(([at, of]) => [x(at), y(of)]), each[number][2]));
    pen.restore();
    words(pen, each.length ? each[0][1] : "", left - 6, 15, colours.faint, "right");
    canvas.timeAt = (at) => end - ((right - at) / (right - left)) * shown;
    for (const [number, at] of [...marks, ...(mouse === null ? [] : [mouse])].entries())
      if (x(at) >= left) line(pen, [[x(at), ceiling], [x(at), base]], number < marks.length ? colours.purple : colours.grey, 1.2, [4, 3]);
    const pointed = mouse === null ? null : seen[Math.min(seen.length - 1, after(seen, mouse))]; // its values stand beside the names
    key(pen, each.map(([label, of, colour, read]) => [pointed ? `${label} ${short(read(pointed))} ${of}` : label, colour]), right - 100, 16, left + 8);
  }

  const leastOf = (of) => ({ mm: 1, "°": 1 })[of] || (hello.axes.some((axis) => axis.effort_unit === of) ? 0.004 * hello.axes[0].effort : 1e-3);

  function thinned(seen, every, read) { // the least and the greatest value of each bin, so that no spike is lost
    if (every < 3) return seen.map((row) => [time(row), read(row)]);
    const found = [];
    for (let at = 0; at < seen.length; at += every) {
      let low = null, high = null;
      for (const row of seen.slice(at, at + every)) {
        const point = [time(row), read(row)];
        if (low === null || point[1] < low[1]) low = point;
        if (high === null || point[1] > high[1]) high = point;
      }
      found.push(...(low[0] < high[0] ? [low, high] : [high, low]));
    }
    return found;
  }

  function facts() {
    const row = newest();
    if (!row) return;
    const states = hello.axes.map((axis) => value(row, axis.name + ".state")), enabled = value(row, "enabled") > 0;
    const now = performance.now(), late = rows.slice(-Math.ceil(hello.rate)).map((each) => value(each, "lateness_us"));
    frames = frames.filter((at) => at > now - 1000);
    const flags = hello.axes.reduce((all, axis) => all | value(row, axis.name + ".flags"), 0);
    const ages = hello.axes.map((axis) => value(row, axis.name + ".age_ns") * 1e-6);
    const shownFacts = {
      drive: [hello.axes.map((axis, number) => (hello.axes.length > 1 ? axis.name + " " : "") + (hello.states[states[number]] || "unknown")).join(", "), !enabled],
      link: [flags ? hello.flags.filter((_, bit) => flags & (1 << bit)).join(", ") : `good, ${Math.max(...ages).toFixed(2)} ms old`, flags !== 0],
      lateness: [`${short(Math.max(...late))} µs at most in 1 s, ${value(row, "missed")} missed`, false],
      "bus-load": [`${(100 * hello.bus_load).toFixed(0)} %`, hello.bus_load > 0.8],
      energy: [`${(1e3 * value(row, "energy")).toFixed(3)} ${hello.energy_limit ? `of ${short(1e3 * hello.energy_limit)} ` : ""}mJ given`, false],
      pictures: [`${frames.length} a second`, false],
    };
    for (const [name, [text, bad]] of Object.entries(shownFacts)) { const place = $("fact-" + name); if (place) { place.textContent = text; place.className = bad ? "bad" : ""; } }
    while (waiting.length && value(row, "changes") >= waiting[0].begun) { // the pictures are those of the scene in force
      const { text, above, scene: begun } = waiting.shift(), title = document.querySelector(".title h1");
      const { parameters } = hello;
      Object.assign(hello, begun, { parameters });
      title.textContent = title.title = hello.scene_text;
      answer(above.length ? "warned" : "made", [`${text} is in force.`, ...above].join(" Warning: "));
    }
    const said = waiting.length && !ended ? `waits: ${waiting.map((each) => each.text).join("; ")}. It begins when it cannot throw the handle: let the handle out of it, or hold it still.` : "";
    if ($("waits").textContent !== said) $("waits").textContent = said;
    if (ended) $("fact-drive").textContent = "the run has ended";
    const t = value(row, "t");
    $("state").textContent = ended ? "ended" : paused ? "paused" : enabled ? "torque enabled" : "no torque";
    $("state").className = ended || paused || !enabled ? "bad" : "good";
    $("time").textContent = Number.isFinite(t) ? `${t.toFixed(2)} s` + (hello.simulated ? ` simulated${speed === 1 ? "" : ` × ${speed}`}` : "") : "–";
    const cursor = $("cursor");
    if (cursor) cursor.textContent = marks.length === 2 ? `Δt ${((marks[1] - marks[0]) * 1e3).toFixed(1)} ms` : held ? "charts held; click sets two cursors"
      : trigger.column && Number.isFinite(trigger.level) ? `trigger: ${trigger.column} at ${short(trigger.level)} ${scaled(trigger.column)[0]}` : "";
  }

  let drawnAt = 0, pictures = 0;
  function draw() {
    requestAnimationFrame(draw);
    alive();
    // Whether there is a new row or not: a pause and an end change words too.
    if (hello && hello.axes && performance.now() - drawnAt > 100) { drawnAt = performance.now(); facts(); }
    if (!hello || !changed || !hello.axes) return;
    changed = false;
    for (const canvas of document.querySelectorAll("canvas[data-kind]")) {
      const { kind, name } = canvas.dataset, axis = hello.axes.find((each) => each.name === name);
      if (!canvas.ready) prepare(canvas, kind, axis);
      if (kind === "handle") handle(canvas, axis); else if (kind === "law") law(canvas, axis); else chart(canvas, name);
    }
    frames.push(performance.now());
    pictures++;
    send({ ack: 1 });
  }

  // Mouse and keys.

  function prepare(canvas, kind, axis) {
    canvas.ready = true;
    if (kind === "chart") {
      canvas.onpointermove = (event) => { mouse = canvas.timeAt(event.offsetX); changed = true; };
      canvas.onpointerleave = () => { mouse = null; changed = true; };
      canvas.onclick = (event) => mark(canvas.timeAt(event.offsetX));
      canvas.onkeydown = (event) => { // the arrows lead a pointer over the held charts, and Enter sets a cursor
        const way = ARROWS[event.key];
        if (event.key === "Enter" && mouse !== null) mark(mouse);
        if (!way) return;
        event.preventDefault();
        if (!held) hold();
        mouse = (mouse === null ? time(last()) - shown / 2 : mouse) + (way * shown) / 100;
        changed = true;
      };
    }
    if (kind !== "handle" || !hello.simulated) return;
    canvas.style.cursor = "grab";
    canvas.style.touchAction = "none"; // a finger leads the hand; on the other pictures it scrolls the page
    const lead = (event) => {
      let target = axis.rotary ? Math.atan2(event.offsetX - canvas.centre[0], canvas.centre[1] - event.offsetY) : canvas.placeAt(event.offsetX);
      if (axis.rotary) { const from = dragged ? dragged.target : value(newest(), axis.name + ".position"); target += 2 * Math.PI * Math.round((from - target) / (2 * Math.PI)); }
      pull(axis.name, target);
    };
    canvas.onpointerdown = (event) => { if (steers) { canvas.setPointerCapture(event.pointerId); lead(event); } };
    canvas.onpointermove = (event) => { if (dragged && dragged.axis === axis.name) lead(event); };
    canvas.onpointerup = canvas.onpointercancel = () => pull(axis.name, null);
    canvas.onkeydown = (event) => { // the arrows lead the hand too, and Enter lets go
      const way = ARROWS[event.key];
      if (event.key === "Enter") pull(axis.name, null);
      if (!way || !steers) return;
      event.preventDefault();
      const from = dragged && dragged.axis === axis.name ? dragged.target : value(newest(), axis.name + ".position");
      pull(axis.name, from + way * 0.02 * (axis.travel[1] - axis.travel[0]));
    };
  }
  function mark(at) { if (!held) hold(); marks = [...marks, at].slice(-2); changed = true; }
  function pull(axis, target) {
    dragged = target === null ? null : { axis, target };
    send({ pull: [axis, target] });
    changed = true;
  }

  document.addEventListener("keydown", (event) => {
    if (event.key === "Escape") { stop(); return; }
    if (event.target.closest("input, textarea, [role=combobox], [role=listbox]") || event.ctrlKey || event.metaKey || event.altKey) return;
    const actions = { h: hold, p: pause, n: step };
    if (actions[event.key]) actions[event.key]();
  }, true);
  document.addEventListener("click", (event) => { if (event.target.closest("#stop")) stop(); });
  addEventListener("resize", () => { changed = true; });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => setTimeout(restyle, 50));
  function start() { // when NiceGUI has drawn the controls
    if (!$("stop") || !document.querySelector("canvas[data-kind]") || !$("role")) { setTimeout(start, 20); return; }
    readColours();
    connect();
    requestAnimationFrame(draw);
  }
  start();
  return { send, change, meant, scene, arm, reset, copy, stop, pause, step, hold, span, theme, columns, saveCsv, savePng, pull, drawn,
    rows: () => rows, pictures: () => pictures, shown: visible, state: () => ({ steers, ended, paused, speed, held: Boolean(held), marks, next, hello, dragged }) };
})();
