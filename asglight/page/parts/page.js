// SPDX-License-Identifier: Apache-2.0
// The page of a shot. Shading is the viewer's shaders, which asglight/page/shaders.py put here; this
// script lays out their uniform blocks (asglight/viewer/uniforms/ball_blocks.py) and listens to the reader.
"use strict";

(() => {
  const $ = (id) => document.getElementById(id);
  const shot = JSON.parse($("shot").textContent);
  const shaders = JSON.parse($("shaders").textContent);

  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const floats = (text) => new Float32Array(bytes(text).buffer);

  const SHEET = 28, LAYER = 4, LOBE = 14; // numbers of each, asglight/page/numbers.py
  const BALL_BYTES = 512, BLOCK_FLOATS = 16;
  const EXPOSURE_REACH = 10; // stops to either side of the one that the page opens with
  const COLUMNS_NARROW = 3, NARROW = 560; // balls a row on a telephone, CSS pixels
  const BALL_SHARE = 0.88; // of a cell

  const data = {};
  for (const name of ["sheets", "layers", "lobes", "albedo"]) data[name] = floats(shot.arrays[name]);
  const ballBlocks = bytes(shot.arrays.balls);
  const outlines = readOutlines();
  const ballCount = shot.roughness.length;
  const layerCount = shot.roughness.filter((one) => one !== null).length;
  const firstSheet = starts(shot.litSheets), firstLobe = starts(shot.litLobes);

  const state = {
    place: startPlace(), playing: false, exposure: shot.exposure, filmic: false,
    solo: new Set(), hover: -1, map: "lobes", outlines: true,
  };

  // Return where each frame begins among what is lit.
  function starts(lit) {
    let sum = 0;
    return lit.map((one) => (sum += one.length) - one.length);
  }

  // ---- WebGL ------------------------------------------------------------------------------------

  const drawing = document.createElement("canvas"); // one for all; what it shows is copied

  function startGraphics() {
    const canvas = drawing;
    const gl = canvas.getContext("webgl2", { antialias: false, preserveDrawingBuffer: true });
    if (!gl) throw new Error("This browser has no WebGL 2, which the page draws with.");
    if (!gl.getExtension("EXT_color_buffer_float")) {
      throw new Error("This browser cannot draw 32-bit floats (EXT_color_buffer_float).");
    }
    const wanted = 4 * BLOCK_FLOATS * Math.max(shot.sheetCount, shot.lobeCount + 1);
    if (wanted > gl.getParameter(gl.MAX_UNIFORM_BLOCK_SIZE)) {
      throw new Error(`${shot.lobeCount} lobes of form ${shot.form} are more than the graphics of ` +
        "this browser shade at once. Fit the shot with fewer (--lobes).");
    }
    const filters = gl.getExtension("OES_texture_float_linear") !== null;
    gl.bindVertexArray(gl.createVertexArray());
    const programs = {};
    for (const name of ["balls", "lobes", "srgb", "filmic"]) {
      programs[name] = compiled(gl, shaders.vertex, shaders[name], name);
    }
    return { gl, canvas, filters, programs, targets: {}, buffers: {}, images: {} };
  }

  function compiled(gl, vertex, fragment, name) {
    const program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) {
        throw new Error(`${name}: ${gl.getShaderInfoLog(shader)}`);
      }
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) {
      throw new Error(`${name}: ${gl.getProgramInfoLog(program)}`);
    }
    return program;
  }

  // Return a target for linear radiance of a size.
  function target(name, width, height) {
    const { gl } = graphics;
    let found = graphics.targets[name];
    if (found && found.width === width && found.height === height) return found;
    if (found) gl.deleteTexture(found.texture);
    const texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32F, width, height);
    filtered(name === "lobes" && graphics.filters ? gl.LINEAR : gl.NEAREST);
    const framebuffer = found ? found.framebuffer : gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
    return (graphics.targets[name] = { texture, framebuffer, width, height });
  }

  function filtered(filter) {
    const { gl } = graphics;
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, filter);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, filter);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
  }

  // Fill a uniform block.
  function block(program, name, binding, values) {
    const { gl } = graphics;
    const buffer = (graphics.buffers[name] ??= gl.createBuffer());
    gl.bindBuffer(gl.UNIFORM_BUFFER, buffer);
    gl.bufferData(gl.UNIFORM_BUFFER, values, gl.DYNAMIC_DRAW);
    gl.uniformBlockBinding(program, gl.getUniformBlockIndex(program, name), binding);
    gl.bindBufferBase(gl.UNIFORM_BUFFER, binding, buffer);
  }

  function cover(viewport) {
    const { gl } = graphics;
    gl.viewport(...viewport);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  // The layer's albedo, in 16 bits where 32 cannot be filtered.
  function albedoTexture() {
    const { gl, filters } = graphics;
    const texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, filters ? gl.RG32F : gl.RG16F, shot.albedoSize, shot.albedoSize, 0,
      gl.RG, gl.FLOAT, data.albedo);
    filtered(gl.LINEAR);
    return texture;
  }

  // ---- what shaders need of a frame -------------------------------------------------------------

  const isShown = (lobe) => state.solo.size === 0 || state.solo.has(lobe);

  // Return the sheets that a ball meets, in its order: narrow alone, both, broad alone.
  function runs(place, ball) {
    const groups = [[], [], []];
    shot.litSheets[place].forEach((sheet, index) => {
      if (!isShown(sheet % shot.lobeCount)) return; // all first sheets of lobes, then all second ones
      const at = firstSheet[place] + index, own = (at * layerCount + ball) * LAYER;
      const [narrow, broad] = ball < layerCount ? [data.layers[own + 2], data.layers[own + 3]] : [1, 0];
      groups[broad === 0 ? 0 : narrow === 0 ? 2 : 1].push(at);
    });
    const order = groups.flat();
    return { order, narrowStop: groups[0].length + groups[1].length, broadStart: groups[0].length };
  }

  // Lay out SheetsBlock and GgxSheetsBlock of shaders/balls.frag.
  function sheetBlocks(ball, order) {
    const sheets = new Float32Array(shot.sheetCount * BLOCK_FLOATS);
    const layers = new Float32Array(shot.sheetCount * BLOCK_FLOATS);
    order.forEach((sheet, index) => {
      const shared = sheet * SHEET, at = index * BLOCK_FLOATS;
      sheets.set(data.sheets.subarray(shared, shared + 11), at);
      sheets.set(data.sheets.subarray(shared + 11, shared + 14), at + 12);
      layers.set(data.sheets.subarray(shared + 14, shared + 22), at);
      if (ball >= layerCount) return;
      const [factor, grazing, narrow, broad] = data.layers.subarray((sheet * layerCount + ball) * LAYER);
      sheets[at + 11] = grazing;
      for (let i = 0; i < 3; ++i) {
        layers[at + 8 + i] = factor * data.sheets[shared + 22 + i];
        layers[at + 12 + i] = factor * data.sheets[shared + 25 + i];
      }
      layers[at + 11] = narrow;
      layers[at + 15] = broad;
    });
    return [sheets, layers];
  }

  // Return the block of a ball, in its cell.
  function ballBlock(ball, cell, run) {
    const block = ballBlocks.slice(ball * BALL_BYTES, (ball + 1) * BALL_BYTES);
    const numbers = new Float32Array(block.buffer), whole = new Int32Array(block.buffer);
    numbers.set([cell.x + cell.size / 2, cell.y + cell.size / 2, cell.size / 2]);
    const isLayered = ball < layerCount, hasBase = numbers[8] || numbers[9] || numbers[10];
    const count = run.order.length;
    whole.set(isLayered ? [run.narrowStop, run.broadStart, count] : [0, 0, 0], 12);
    whole[15] = hasBase ? count : 0;
    return block;
  }

  // Lay out LobesBlock of shaders/lobes_block.glsl.
  function lobesBlock(place) {
    const numbers = new Float32Array(4 + shot.lobeCount * BLOCK_FLOATS);
    const whole = new Int32Array(numbers.buffer);
    let count = 0;
    shot.litLobes[place].forEach((lobe, index) => {
      if (!isShown(lobe)) return;
      const from = (firstLobe[place] + index) * LOBE, at = 4 + count * BLOCK_FLOATS;
      const [x, y, z, sharpness, light] = [[0, 3], [3, 6], [6, 9], [9, 11], [11, 14]]
        .map(([first, end]) => data.lobes.subarray(from + first, from + end));
      numbers.set(x, at);
      numbers[at + 3] = sharpness[0];
      numbers.set(y, at + 4);
      numbers[at + 7] = sharpness[1];
      numbers.set(z, at + 8);
      numbers.set(light, at + 12);
      ++count;
    });
    whole[0] = count;
    whole[1] = shot.formNumber;
    return numbers;
  }

  // ---- drawing ----------------------------------------------------------------------------------

  function columns() {
    return $("stage").clientWidth < NARROW ? COLUMNS_NARROW : ballCount;
  }

  // Return cells of balls in a picture of a width in pixels, and its height.
  function arrangement(width) {
    const across = columns(), pitch = Math.floor(width / across);
    const size = Math.max(1, Math.round(pitch * BALL_SHARE));
    const left = (width - across * pitch + pitch - size) >> 1, top = (pitch - size) >> 1;
    const cells = shot.roughness.map((_, ball) => ({
      x: left + (ball % across) * pitch, y: top + Math.floor(ball / across) * pitch, size,
    }));
    return { cells, height: Math.ceil(ballCount / across) * pitch };
  }

  function drawBalls(width, height, cells) {
    const { gl, programs } = graphics, program = programs.balls;
    const drawn = target("balls", width, height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, drawn.framebuffer);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.useProgram(program);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, graphics.albedo);
    gl.uniform1i(gl.getUniformLocation(program, "u_albedo_table"), 0);
    cells.forEach((cell, ball) => {
      const run = runs(state.place, ball);
      const [sheets, layers] = sheetBlocks(ball, run.order);
      block(program, "SheetsBlock", 0, sheets);
      block(program, "GgxSheetsBlock", 1, layers);
      block(program, "BallBlock", 2, ballBlock(ball, cell, run));
      cover([cell.x, cell.y, cell.size, cell.size]);
    });
    return drawn.texture;
  }

  function drawLobes() {
    const { gl, programs } = graphics, program = programs.lobes;
    const drawn = target("lobes", 2 * shot.mapRows, shot.mapRows);
    gl.bindFramebuffer(gl.FRAMEBUFFER, drawn.framebuffer);
    gl.useProgram(program);
    block(program, "LobesBlock", 0, lobesBlock(state.place));
    gl.uniform2f(gl.getUniformLocation(program, "u_size"), drawn.width, drawn.height);
    cover([0, 0, drawn.width, drawn.height]);
    return drawn.texture;
  }

  // Show a texture of radiance in a canvas of the page, upright; what was asked for in pixels.
  function show(texture, canvas, width, height) {
    const { gl, programs } = graphics, program = programs[state.filmic ? "filmic" : "srgb"];
    if (graphics.canvas.width !== width || graphics.canvas.height !== height) {
      graphics.canvas.width = width;
      graphics.canvas.height = height;
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.useProgram(program);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    const place = (name) => gl.getUniformLocation(program, name);
    for (const name of ["u_fit", "u_fit_background", "u_scale"]) gl.uniform1i(place(name), 0);
    gl.uniform4f(place("u_area"), 0, height, width, -height); // rows count from the top
    gl.uniform1f(place("u_exposure_ev"), state.exposure);
    gl.uniform1i(place("u_channel"), 0);
    gl.uniform1i(place("u_zebra"), 0);
    gl.uniform3f(place("u_surround"), ...shot.surround);
    cover([0, 0, width, height]);
    if (canvas.width !== width || canvas.height !== height) {
      canvas.width = width;
      canvas.height = height;
    }
    canvas.getContext("2d").drawImage(graphics.canvas, 0, 0);
  }

  const pixels = (canvas) =>
    Math.max(1, Math.round(canvas.parentElement.clientWidth * (window.devicePixelRatio || 1)));

  function draw() {
    if (graphics.gl.isContextLost()) return; // what was drawn stays
    const width = pixels($("balls")), { cells, height } = arrangement(width);
    show(drawBalls(width, height, cells), $("balls"), width, height);
    const onMap = pixels($("map"));
    const radiance = state.map === "lobes" ? drawLobes() : graphics.images.map;
    if (radiance) show(radiance, $("map"), onMap, onMap >> 1);
    if (state.outlines) drawOutlines($("map"));
    if (shot.reference) drawReference(width, height, cells);
  }

  function drawOutlines(canvas) {
    const pen = canvas.getContext("2d"), { width, height } = canvas;
    const thin = Math.max(1, width / 900);
    for (const { lobe, points } of outlines[state.place]) {
      const isBold = lobe === state.hover || state.solo.has(lobe);
      pen.beginPath();
      for (let i = 0; i < points.length; i += 2) {
        pen.lineTo((points[i] / 65535) * width, (points[i + 1] / 65535) * height);
      }
      pen.globalAlpha = isShown(lobe) ? 1 : 0.25;
      pen.strokeStyle = "#000a";
      pen.lineWidth = thin * (isBold ? 4 : 2.4);
      pen.stroke();
      pen.strokeStyle = isBold ? "#f0a63c" : "#e4e4e2";
      pen.lineWidth = thin * (isBold ? 2.4 : 1);
      pen.stroke();
    }
    pen.globalAlpha = 1;
  }

  function readOutlines() {
    const every = new Uint16Array(bytes(shot.arrays.outlines).buffer);
    let at = 0;
    return shot.outlineBytes.map((size) => {
      const end = at + size / 2, curves = [];
      while (at < end) {
        const [lobe, count] = every.subarray(at, at + 2);
        curves.push({ lobe, points: every.subarray(at + 2, at + 2 + 2 * count) });
        at += 2 + 2 * count;
      }
      return curves;
    });
  }

  // ---- the reference ----------------------------------------------------------------------------

  // Decode the picture of a frame and take its radiance as textures; then draw again.
  function readReference(place) {
    const image = new Image();
    image.onload = () => {
      if (place !== state.place) return;
      const { rows, ball } = shot.reference, canvas = document.createElement("canvas");
      canvas.width = image.width;
      canvas.height = image.height;
      const pen = canvas.getContext("2d", { willReadFrequently: true });
      pen.drawImage(image, 0, 0);
      const radiance = reference(place);
      upload("map", pen.getImageData(0, 0, 2 * rows, rows), () => radiance[0], () => 1);
      upload("truth", pen.getImageData(0, rows, ballCount * ball, ball),
        (x) => radiance[1 + Math.floor(x / ball)], (x, y) => coverage(x % ball, y, ball));
      graphics.shownReference = place;
      draw();
    };
    image.src = `data:image/jpeg;base64,${shot.reference.pictures[place]}`;
  }

  // Return the radiance of each level, of the map and of every ball: asglight/page/reference.py.
  function reference(place) {
    const ends = shot.reference.ranges[place], tables = [];
    for (let part = 0; part < ends.length; part += 2) {
      const { darkest } = shot.reference, step = (ends[part + 1] - ends[part]) / (255 - darkest);
      tables.push(Float32Array.from({ length: 256 }, (_, level) =>
        level < darkest / 2 ? 0 : 2 ** (ends[part] + (level - darkest) * step)));
    }
    return tables;
  }

  // Share of a pixel that a ball covers, as shaders/balls.frag has it.
  function coverage(x, y, size) {
    const distance = Math.hypot(x + 0.5 - size / 2, y + 0.5 - size / 2);
    return Math.min(1, Math.max(0, size / 2 - distance + 0.5));
  }

  // Make a texture of a picture: radiance of its levels, multiplied by the coverage.
  function upload(name, picture, tableOf, coverageOf) {
    const { gl, filters } = graphics, { width, height, data: levels } = picture;
    const texels = new Float32Array(4 * width * height);
    for (let i = 0; i < width * height; ++i) {
      const x = i % width, table = tableOf(x), alpha = coverageOf(x, Math.floor(i / width));
      for (let c = 0; c < 3; ++c) texels[4 * i + c] = alpha * table[levels[4 * i + c]];
      texels[4 * i + 3] = alpha;
    }
    gl.bindTexture(gl.TEXTURE_2D, (graphics.images[name] ??= gl.createTexture()));
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, width, height, 0, gl.RGBA, gl.FLOAT, texels);
    filtered(filters ? gl.LINEAR : gl.NEAREST);
  }

  // Put the balls of the reference where those of the lobes are.
  function drawReference(width, height, cells) {
    if (graphics.shownReference !== state.place) return readReference(state.place);
    const strip = document.createElement("canvas"), size = cells[0].size;
    show(graphics.images.truth, strip, ballCount * size, size);
    const canvas = $("truth"), pen = canvas.getContext("2d");
    canvas.width = width;
    canvas.height = height;
    pen.fillStyle = `rgb(${shot.surround.map((one) => Math.round(255 * one)).join(" ")})`;
    pen.fillRect(0, 0, width, height);
    cells.forEach((cell, ball) => {
      pen.drawImage(strip, ball * size, 0, size, size, cell.x, cell.y, size, size);
    });
  }

  // ---- words ------------------------------------------------------------------------------------

  const NAMES = {
    env: "map", flux: "total light", irr: "white ball", irrMax: "white ball, worst side",
    "r0.5": "roughness 0.5", "r0.25": "roughness 0.25",
  };

  function tell() {
    const { place } = state, count = shot.frames.length;
    const seconds = (shot.frames[place] - shot.frames[0]) / shot.fps;
    $("frame").textContent = `${shot.frames[place]} \u00B7 ${seconds.toFixed(2)} s`;
    $("time").value = place;
    $("play").textContent = state.playing ? "\u275A\u275A" : "\u25B6";
    $("play").setAttribute("aria-label", state.playing ? "Pause" : "Play");
    $("stops").textContent = `${state.exposure >= 0 ? "+" : ""}${state.exposure.toFixed(1)} stops`;
    $("exposure").value = state.exposure;
    $("filmic").setAttribute("aria-pressed", state.filmic);
    $("all").hidden = state.solo.size === 0;
    const flux = shot.flux[place], total = flux.reduce((sum, one) => sum + one, 0);
    const lit = flux.filter((one) => one > 0).length;
    $("facts").textContent = `${count} frame${count === 1 ? "" : "s"} at ${+shot.fps.toFixed(3)} fps, ` +
      `${shot.lobeCount} lobes of form ${shot.form}, ${lit} lit, flux ${total.toPrecision(4)}`;
    [...$("lobes").children].forEach((row, lobe) => {
      const button = row.firstChild, [colour, , share, size] = button.children;
      const from = (firstLobe[place] + shot.litLobes[place].indexOf(lobe)) * LOBE + 11;
      colour.style.background = flux[lobe] > 0 ? hue(data.lobes.subarray(from, from + 3)) : "#000";
      share.textContent = flux[lobe] > 0 ? `${(100 * flux[lobe] / total).toFixed(1)} %` : "dark";
      const [x, y] = shot.width[place].slice(2 * lobe, 2 * lobe + 2);
      size.textContent = flux[lobe] > 0 ? degrees(2 * Math.sqrt(x * y)) : "";
      button.classList.toggle("dark", !(flux[lobe] > 0) || !isShown(lobe));
      button.setAttribute("aria-pressed", state.solo.has(lobe));
    });
    if (shot.reference) {
      const errors = shot.reference.errors[place];
      [...$("errors").tBodies[0].rows].forEach((row) => {
        const error = errors[row.dataset.name], percent = Math.abs(100 * error);
        row.cells[1].textContent = error === null ? "\u221E" // light beside a black reference
          : percent < 0.01 ? "< 0.01 %" : `${percent.toPrecision(2)} %`;
      });
    }
  }

  const degrees = (angle) => `${angle < 10 ? angle.toPrecision(2) : Math.round(angle)}\u00B0`;

  // Return the colour of a light without its strength.
  function hue(light) {
    const peak = Math.max(...light, 1e-30);
    return `rgb(${[...light].map((one) => Math.round(255 * (one / peak) ** (1 / 2.2))).join(" ")})`;
  }

  function fillWords() {
    $("time").max = shot.frames.length - 1;
    $("transport").hidden = shot.frames.length === 1;
    $("exposure").min = shot.exposure - EXPOSURE_REACH;
    $("exposure").max = shot.exposure + EXPOSURE_REACH;
    shot.names.forEach((name, lobe) => {
      const row = document.createElement("li"), button = document.createElement("button");
      button.type = "button";
      button.title = `Show ${name} alone`;
      for (const [tag, text] of [["i", ""], ["span", name], ["span", ""], ["span", ""]]) {
        button.append(Object.assign(document.createElement(tag), { textContent: text }));
      }
      button.onclick = () => change(() => state.solo.delete(lobe) || state.solo.add(lobe));
      button.onpointerenter = () => change(() => { state.hover = lobe; });
      button.onpointerleave = () => change(() => { state.hover = -1; });
      row.append(button);
      $("lobes").append(row);
    });
    if (!shot.reference) return;
    for (const id of ["reference-balls", "map-choice", "errors"]) $(id).hidden = false;
    $("map-name").hidden = true;
    for (const name of Object.keys(shot.reference.errors[0])) {
      const row = $("errors").tBodies[0].insertRow();
      row.dataset.name = name;
      row.insertCell().innerHTML = `${NAMES[name]} <small>${name}</small>`;
      row.insertCell();
    }
  }

  function labelBalls() {
    const labels = document.querySelector(".labels");
    labels.style.gridTemplateColumns = `repeat(${columns()}, 1fr)`;
    labels.replaceChildren(...shot.roughness.map((one) =>
      Object.assign(document.createElement("span"), { textContent: one === null ? "matte" : `roughness ${one}` })));
  }

  // ---- the reader -------------------------------------------------------------------------------

  // Return the place of the frame that the address names, as page.html#1024; else the first.
  function startPlace() {
    const named = location.hash.slice(1);
    return named === "" ? 0 : Math.max(shot.frames.indexOf(Number(named)), 0);
  }

  let isWaiting = false;

  // Change what is shown, and show it with the next picture of the screen.
  function change(how) {
    how();
    if (isWaiting) return;
    isWaiting = true;
    requestAnimationFrame(() => {
      isWaiting = false;
      tell();
      draw();
    });
  }

  function play() {
    state.playing = !state.playing;
    const { frames } = shot, first = frames[0], length = frames[frames.length - 1] - first + 1;
    const start = frames[state.place] - first, begin = performance.now();
    const step = (now) => {
      if (!state.playing) return;
      const played = start + Math.floor(Math.max(0, now - begin) / 1000 * shot.fps);
      const frame = first + played % length; // a frame that is not there shows the one before it
      const place = frames.filter((one) => one <= frame).length - 1;
      if (place !== state.place) change(() => { state.place = place; });
      requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
    change(() => {});
  }

  function listen() {
    $("time").oninput = () => change(() => { state.playing = false; state.place = Number($("time").value); });
    $("play").onclick = play;
    $("exposure").oninput = () => change(() => { state.exposure = Number($("exposure").value); });
    $("reset").onclick = () => change(() => { state.exposure = shot.exposure; });
    $("filmic").onclick = () => change(() => { state.filmic = !state.filmic; });
    $("all").onclick = () => change(() => state.solo.clear());
    $("outlines").onchange = () => change(() => { state.outlines = $("outlines").checked; });
    for (const button of $("map-choice").children) {
      button.onclick = () => change(() => {
        state.map = button.dataset.map;
        for (const one of $("map-choice").children) one.setAttribute("aria-pressed", one === button);
      });
    }
    drawing.addEventListener("webglcontextlost", (event) => {
      event.preventDefault(); // else the browser never gives it back
      trouble("The browser has taken the graphics away. The page draws again when they are back.");
    });
    drawing.addEventListener("webglcontextrestored", () => orTrouble(() => {
      begin();
      trouble("");
      change(() => {});
    }));
    window.onhashchange = () => change(() => { state.place = startPlace(); });
    window.onresize = () => change(labelBalls);
    document.onkeydown = (event) => {
      if (event.altKey || event.ctrlKey || event.metaKey) return; // the browser's own, such as back
      if (event.target.matches("input, button") && event.key === " ") return;
      const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
      const last = shot.frames.length - 1;
      if (event.key === " ") play();
      else if (step && event.target.type !== "range") {
        change(() => {
          state.playing = false;
          state.place = Math.min(last, Math.max(0, state.place + step));
        });
      } else return;
      event.preventDefault();
    };
  }

  let graphics;

  function begin() {
    graphics = startGraphics();
    graphics.albedo = albedoTexture();
  }

  function trouble(text) {
    $("trouble").textContent = text;
    $("trouble").hidden = text === "";
  }

  // Do something, and show on the page why it failed.
  function orTrouble(how) {
    try {
      how();
    } catch (error) {
      trouble(error.message);
      throw error;
    }
  }

  orTrouble(() => {
    begin();
    fillWords();
    labelBalls();
    listen();
    tell();
    draw();
  });
})();
