"use strict";
(function () {
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const divs = Array.from(document.querySelectorAll("[data-figure]"));
  function theme(layout) {
    const style = getComputedStyle(document.documentElement);
    const ink = style.getPropertyValue("--ink").trim();
    const grid = style.getPropertyValue("--grid").trim();
    const update = { "font.color": ink };
    for (const key of Object.keys(layout)) {
      if (/^[xy]axis[0-9]*$/.test(key)) {
        update[key + ".gridcolor"] = grid;
        update[key + ".zerolinecolor"] = grid;
        update[key + ".linecolor"] = grid;
      }
      if (/^scene[0-9]*$/.test(key)) {
        for (const axis of ["xaxis", "yaxis", "zaxis"]) {
          update[key + "." + axis + ".gridcolor"] = grid;
          update[key + "." + axis + ".zerolinecolor"] = grid;
          update[key + "." + axis + ".color"] = ink;
        }
      }
    }
    return update;
  }
  function draw(div) {
    const figure = JSON.parse(document.getElementById(div.dataset.figure).textContent);
    if (figure.layout.scene && div.clientWidth < 600) {
      figure.layout.height = 420;
      figure.layout.scene.camera = { eye: { x: 1.9, y: 1.9, z: 1.3 } };
    }
    const buttons = [["toImage"], ["zoom3d", "pan3d", "orbitRotation", "tableRotation"], ["resetCameraDefault3d"]];
    const space = Boolean(figure.layout.scene);
    const config = { responsive: true, typesetMath: false, displaylogo: false, displayModeBar: space, modeBarButtons: space ? buttons : false };
    return Plotly.newPlot(div, figure.data, figure.layout, config).then(function () {
      return Plotly.relayout(div, theme(figure.layout));
    });
  }
  const choice = document.getElementById("pose-choice");
  if (choice) {
    choice.addEventListener("change", function () {
      const div = document.getElementById("shapes-in-space");
      const only = choice.value === "" ? null : Number(choice.value);
      Plotly.restyle(div, { visible: div.data.map(function (trace) { return only === null || trace.meta === only; }) });
    });
  }
  dark.addEventListener("change", function () {
    divs.forEach(function (div) { Plotly.relayout(div, theme(div.layout)); });
  });
  Promise.all(divs.map(draw)).then(function () {
    document.documentElement.dataset.drawn = String(divs.length);
  });
})();
