"use strict";
// The script of the page: places figures, colours maps, moves the structure.  Data come from the element "data"; nothing is loaded.
(function () {
  const data = JSON.parse(document.getElementById("data").textContent);
  const at = (id) => document.getElementById(id);
  const font = { family: "system-ui, 'Segoe UI', Roboto, 'DejaVu Sans', sans-serif", size: 12, color: "#1c2330" };
  // Newer plotly has a button that sends the chart to a server.
  const removed = ["lasso2d", "select2d", "autoScale2d", "sendChartToCloud", "sendDataToCloud"];
  const config = { responsive: true, displaylogo: false, plotlyServerURL: "", modeBarButtonsToRemove: removed };

  // -- curves -----------------------------------------------------------------------------------------------------------

  function place(div) {
    const figure = data.figures[div.dataset.figure];
    const axis = { gridcolor: "#e8eaef", linecolor: "#98a2b3", zeroline: false, showline: true, automargin: true };
    const layout = {
      font, margin: { l: 64, r: 36, t: 12, b: 48 }, modebar: { orientation: "v" }, hovermode: "closest", hoverdistance: 40, plot_bgcolor: "#fff", paper_bgcolor: "#fff",
      legend: { orientation: "h", y: 1.02, yanchor: "bottom", x: 0 }, showlegend: figure.data.length > 1,
      xaxis: { ...axis, ...figure.layout.xaxis }, yaxis: { ...axis, ...figure.layout.yaxis },
    };
    Plotly.newPlot(div, figure.data, layout, config);
  }

  // -- maps of the joint ------------------------------------------------------------------------------------------------

  const missing = "#ececec";

  function colourOf(quantity, most, value) {
    if (quantity.is_state) return quantity.colours[value];
    if (!(value > 0)) return missing;
    return quantity.colours[Math.min(quantity.colours.length - 1, Math.floor((value / most) * quantity.colours.length))];
  }

  function startMaps() {
    const level = at("map-level"), quantity = at("map-quantity"), cells = document.querySelectorAll(".surface [data-pair]");
    if (!level) return;
    data.maps.levels.forEach((entry, i) => level.add(new Option(entry.name, i)));
    data.maps.quantities.forEach((entry, i) => quantity.add(new Option(entry.heading + (entry.unit ? " [" + entry.unit + "]" : ""), i)));
    level.selectedIndex = data.maps.levels.length - 1;
    const largest = data.maps.quantities.map((entry) => entry.values.flat().reduce((a, b) => Math.max(a, b), 0));
    function paint() {
      const chosen = data.maps.quantities[quantity.selectedIndex], most = largest[quantity.selectedIndex];
      const values = chosen.values[level.selectedIndex];
      for (const cell of cells) cell.style.fill = cell.style.stroke = colourOf(chosen, most, values[cell.dataset.pair]);
      legend(chosen, most, values);
    }
    level.onchange = quantity.onchange = paint;
    const tip = at("tip");
    for (const svg of document.querySelectorAll(".surface svg")) {
      svg.onpointermove = (event) => {
        const pair = event.target.dataset.pair;
        tip.hidden = pair === undefined;
        if (tip.hidden) return;
        const lines = data.maps.quantities.map((entry) => {
          const value = entry.values[level.selectedIndex][pair];
          return entry.heading + ": " + (entry.is_state ? data.maps.states[value] : value + " " + entry.unit);
        });
        tip.textContent = data.maps.labels[pair] + "\n" + lines.join("\n");
        tip.style.left = Math.max(4, Math.min(event.clientX + 14, innerWidth - tip.offsetWidth - 8)) + "px";
        tip.style.top = Math.max(4, Math.min(event.clientY + 14, innerHeight - tip.offsetHeight - 8)) + "px";
      };
      svg.onpointerleave = () => { tip.hidden = true; };
    }
    paint();
  }

  function legend(quantity, most, values) {
    const box = at("legend");
    box.textContent = "";
    const entry = (colour, text) => {
      const span = document.createElement("span"), patch = document.createElement("i");
      patch.style.background = colour;
      span.append(patch, text);
      box.append(span);
    };
    if (quantity.is_state) {
      data.maps.states.forEach((name, k) => entry(quantity.colours[k], values.filter((value) => value === k).length + " " + name));
      return;
    }
    entry(missing, "none");
    const bar = document.createElement("span");
    bar.className = "bar";
    bar.style.background = "linear-gradient(90deg," + quantity.colours.join(",") + ")";
    box.append("0", bar, most + " " + quantity.unit, " one scale for all levels");
  }

  // -- the structure in space -------------------------------------------------------------------------------------------

  const arrays = { f4: Float32Array, i4: Int32Array, i2: Int16Array };

  function unpacked(text, kind) {
    const raw = atob(text), bytes = new Uint8Array(raw.length);
    for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
    return new arrays[kind](bytes.buffer);
  }

  function split(points) {
    const n = points.length / 3, xyz = [0, 1, 2].map(() => new Float32Array(n));
    for (let i = 0; i < n; i++) for (let k = 0; k < 3; k++) xyz[k][i] = points[3 * i + k];
    return xyz;
  }

  function pick(xyz, nodes) {
    return xyz.map((values) => Float32Array.from(nodes, (node) => values[node]));
  }

  function corners(triangles) {
    const n = triangles.length / 3, columns = [0, 1, 2].map(() => new Int32Array(n));
    for (let i = 0; i < n; i++) for (let k = 0; k < 3; k++) columns[k][i] = triangles[3 * i + k];
    return { i: columns[0], j: columns[1], k: columns[2] };
  }

  // The places xyz moved by a motion (n_coefficients, 3, n) at an angle of the period.
  function moved(xyz, motion, u, angle, times) {
    const n = xyz[0].length;
    const at_angle = motion.orders.map((order, k) => (motion.sine[k] ? Math.sin(order * angle) : Math.cos(order * angle)));
    return xyz.map((values, axis) => {
      const result = Float32Array.from(values);
      at_angle.forEach((share, k) => {
        const factor = times * motion.scale * share, start = (3 * k + axis) * n;
        if (factor !== 0) for (let i = 0; i < n; i++) result[i] += factor * u[start + i];
      });
      return result;
    });
  }

  // The largest displacement of a node over a period [m].
  function reach(xyz, motion, u) {
    let most = 0;
    for (let step = 0; step < 16; step++) {
      const [x, y, z] = moved(xyz.map((values) => new Float32Array(values.length)), motion, u, (step * Math.PI) / 8, 1);
      for (let i = 0; i < x.length; i++) most = Math.max(most, Math.hypot(x[i], y[i], z[i]));
    }
    return most;
  }

  const light = { ambient: 0.55, diffuse: 0.75, specular: 0.12, roughness: 0.7, fresnel: 0.1 };

  // How the box of ranges is seen from a place; its longest side is ``high`` of plotly's units.
  function scene(range, spun, high) {
    const axis = (k) => ({ visible: false, range: range[k], autorange: false });
    const size = range.map(([low, high]) => high - low), most = Math.max(...size);
    return {
      xaxis: axis(0), yaxis: axis(1), zaxis: axis(2), aspectmode: "manual",
      aspectratio: { x: (high * size[0]) / most, y: (high * size[1]) / most, z: (high * size[2]) / most },
      camera: { eye: spun, up: { x: 0, y: 0, z: 1 }, projection: { type: "orthographic" } }, dragmode: "orbit",
    };
  }

  function layout3d(div, range, eye, high) {
    const below = { orientation: "h", x: 0, y: 0, yanchor: "top", font: { ...font, size: 11 } }; // many bodies would hide a narrow view
    return {
      font, margin: { l: 0, r: 0, t: 0, b: 0 }, paper_bgcolor: "#fff", uirevision: "kept", scene: scene(range, eye, high),
      legend: div.clientWidth < 560 ? below : { x: 0, y: 1, bgcolor: "#ffffffcc" }, showlegend: true,
    };
  }

  function ranges(xyz, margin) {
    return xyz.map((values) => {
      let low = Infinity, high = -Infinity;
      for (const value of values) { low = Math.min(low, value); high = Math.max(high, value); }
      return [low - margin, high + margin];
    });
  }

  const eye = (angle) => ({ x: 1.0 * Math.cos(angle), y: 1.0 * Math.sin(angle), z: 0.45 });

  function startMesh(view, xyz, bodies, joint) {
    const div = at("mesh"), edges = unpacked(view.edges, "i4"), lines = [[], [], []];
    for (let e = 0; e < edges.length; e += 2)
      for (let k = 0; k < 3; k++) lines[k].push(xyz[k][edges[e]], xyz[k][edges[e + 1]], null);
    const traces = bodies.map((body) => ({
      type: "mesh3d", x: body.xyz[0], y: body.xyz[1], z: body.xyz[2], ...body.corners, color: body.colour, flatshading: true,
      lighting: light, name: body.name, showlegend: true, hoverinfo: "name",
    }));
    traces.push({ type: "scatter3d", mode: "lines", x: lines[0], y: lines[1], z: lines[2], line: { color: "#39414d", width: 1 }, name: "edges", hoverinfo: "skip" });
    if (joint)
      traces.push({ type: "mesh3d", x: joint.xyz[0], y: joint.xyz[1], z: joint.xyz[2], ...joint.corners, color: "#c0392b", flatshading: true, name: "contact surfaces", showlegend: true, hoverinfo: "name" });
    Plotly.newPlot(div, traces, layout3d(div, ranges(xyz, 0.02 * view.diagonal), eye(-1.0), 1.85), config);
  }

  function startMotion(view, xyz, bodies, joint) {
    const div = at("view"), choice = at("shown"), play = at("play"), spin = at("spin"), clear = at("clear"), alone = at("alone"), slider = at("scale");
    for (const [i, entry] of view.shown.entries()) {
      entry.all = unpacked(entry.u, "i2");
      entry.reach = reach(xyz, entry, entry.all) || 1;
      entry.sizes = unpacked(entry.size, "f4");
      choice.add(new Option(entry.name, i));
    }
    const peaks = view.shown.filter((entry) => entry.kind === "level").length;
    choice.selectedIndex = Math.max(0, peaks - 1);
    const margin = 0.1 * view.diagonal, n = bodies.length;
    let running = !matchMedia("(prefers-reduced-motion: reduce)").matches, angle = 0.25 * Math.PI, turn = -1.0, last = 0, busy = false;
    const current = () => view.shown[choice.selectedIndex];
    const times = () => (0.08 * view.diagonal / current().reach) * 10 ** Number(slider.value);

    function places() {
      const shown = current(), positions = bodies.map((body) => pick(moved(xyz, shown, shown.all, angle, times()), body.nodes));
      if (joint) positions.push(shown.kind === "level" && joint.motions[shown.number] ? moved(joint.xyz, joint.motions[shown.number], joint.motions[shown.number].all, angle, times()) : joint.xyz);
      return positions;
    }

    function traces3d() {
      const shown = current(), positions = places();
      const heading = { level: "amplitude", mode: "shape", rest: "displacement" }[shown.kind];
      const traces = bodies.map((body, b) => ({
        type: "mesh3d", x: positions[b][0], y: positions[b][1], z: positions[b][2], ...body.corners, lighting: light, flatshading: false,
        intensity: Float32Array.from(body.nodes, (node) => shown.sizes[node]), cmin: 0, cmax: shown.most || 1, colorscale: "Viridis",
        opacity: clear.checked && joint ? 0.42 : 1, name: body.name, showlegend: true, showscale: b === 0, visible: alone.checked ? "legendonly" : true,
        colorbar: { thickness: 12, len: 0.6, x: 1, xanchor: "right", title: { text: heading + (shown.unit ? " [" + shown.unit + "]" : ""), side: "right" } },
        hovertemplate: body.name + "<br>%{intensity:.4g} " + shown.unit + "<extra></extra>",
      }));
      if (joint) {
        const index = shown.kind === "level" ? data.maps.levels.findIndex((level) => level.number === shown.number) : -1;
        const states = data.maps.quantities[0];
        const colours = Array.from(joint.pair, (pair) => (index < 0 ? "#d0d4db" : states.colours[states.values[index][pair]]));
        traces.push({
          type: "mesh3d", x: positions[n][0], y: positions[n][1], z: positions[n][2], ...joint.corners, facecolor: colours, flatshading: true,
          lighting: { ...light, ambient: 0.8 }, name: "joint", hoverinfo: "skip", showlegend: false,
        });
        if (index >= 0) data.maps.states.forEach((name, k) => traces.push({
          type: "scatter3d", mode: "markers", x: [null], y: [null], z: [null], marker: { color: states.colours[k], size: 8, symbol: "square" }, name, hoverinfo: "skip" }));
      }
      return traces;
    }

    const range = ranges(xyz, margin), near = joint ? ranges(joint.xyz, 0.01 * view.diagonal) : range;
    alone.disabled = !joint;
    const drawn = () => { at("times").textContent = current().kind === "mode" ? "" : "× " + Number(times().toPrecision(2)); };
    function redraw() {
      drawn();
      const before = div.layout ? div.layout.scene.camera : null, layout = layout3d(div, alone.checked ? near : range, eye(turn), alone.checked ? 1.6 : 2.3);
      if (before) layout.scene.camera = before;
      return Plotly.react(div, traces3d(), layout, config);
    }

    function step(now) {
      requestAnimationFrame(step);
      if (busy || now - last < 33 || !(running || spin.checked) || document.hidden || !inSight(div)) return;
      const passed = Math.min(0.1, (now - last) / 1000);
      last = now;
      busy = true;
      if (running) angle += passed * 2.2;
      const changes = {}, positions = running ? places() : null, traces = [];
      if (positions) {
        for (const k of [0, 1, 2]) changes["xyz"[k]] = positions.map((values) => values[k]);
        positions.forEach((_, i) => traces.push(i));
      }
      const view_changes = {};
      if (spin.checked && !dragging) {
        turn += passed * 0.35;
        view_changes["scene.camera.eye"] = eye(turn);
      }
      const done = positions ? Plotly.update(div, changes, view_changes, traces) : Plotly.relayout(div, view_changes);
      Promise.resolve(done).finally(() => { busy = false; });
    }

    let dragging = false;
    div.addEventListener("pointerdown", () => { dragging = true; spin.checked = false; });
    addEventListener("pointerup", () => { dragging = false; });
    play.textContent = running ? "pause" : "play";
    if (!running) spin.checked = false;
    play.onclick = () => { running = !running; play.textContent = running ? "pause" : "play"; };
    choice.onchange = clear.onchange = alone.onchange = redraw;
    slider.oninput = () => { drawn(); if (!running) redraw(); };
    at("view-note").textContent = "Motion over a period, drawn at the scale above; amplitude by colour, joint by the states of its pairs. Drag to turn it." +
      (view.coarser ? " The surface is shown by " + view.n + " of its " + view.coarser + " nodes." : "") +
      (joint ? "" : " The joint is not drawn.");
    redraw().then(() => requestAnimationFrame(step));
  }

  function inSight(div) {
    const box = div.getBoundingClientRect();
    return box.bottom > 0 && box.top < innerHeight;
  }

  function startViews() {
    const view = data.view;
    if (!view || !at("view")) return;
    const xyz = split(unpacked(view.points, "f4"));
    const bodies = view.bodies.map((body) => {
      const nodes = unpacked(body.nodes, "i4");
      return { ...body, nodes, xyz: pick(xyz, nodes), corners: corners(unpacked(body.triangles, "i4")) };
    });
    let joint = null;
    if (view.joint) {
      for (const motion of Object.values(view.joint.motions)) motion.all = unpacked(motion.u, "i2");
      joint = { ...view.joint, xyz: split(unpacked(view.joint.points, "f4")), corners: corners(unpacked(view.joint.triangles, "i4")), pair: unpacked(view.joint.pair, "i4") };
    }
    startMotion(view, xyz, bodies, joint);
    startMesh(view, xyz, bodies, joint);
  }

  document.querySelectorAll(".figure").forEach(place);
  if (data.maps) startMaps();
  try {
    startViews();
  } catch (problem) {
    for (const id of ["view", "mesh"]) if (at(id)) at(id).textContent = "This browser cannot draw in space (WebGL): " + problem.message;
  }
})();
