// Makes the row of buttons, which have the effects of keys for users without a keyboard.
import {element, svgElement} from "./dom.js";

const kTools = [
  {
    key: "f",
    label: "Frame the model (F)",
    icon: "M3 7V3h4M13 3h4v4M17 13v4h-4M7 17H3v-4M7 10a3 3 0 1 0 6 0a3 3 0 1 0-6 0"
  },
  {
    key: "o",
    label: "Orthographic view (O)",
    toggle: true,
    wide: true,
    icon: "M4 7l6-3 6 3v7l-6 3-6-3zM4 7l6 3 6-3M10 10v7"
  },
  {key: "x", label: "Section plane (X)", toggle: true, icon: "M4 6l6-3 6 3v8l-6 3-6-3zM2 13l16-6"},
  {key: "m", label: "Measure (M)", toggle: true, icon: "M2 13L13 2l5 5L7 18zM6 9l2 2M9 6l2 2M12 3l2 2"},
  {
    key: "c",
    label: "Colours by resolution (C)",
    toggle: true,
    wide: true,
    icon: "M3 3h6v6H3zM11 3h6v6h-6zM3 11h6v6H3zM11 11h3v3h-3zM14 14h3v3h-3z"
  },
  {
    key: "l",
    label: "Magnifying glass (L)",
    toggle: true,
    splats: true,
    icon: "M3 8.5a5.5 5.5 0 1 0 11 0a5.5 5.5 0 1 0-11 0M12.5 12.5L17 17"
  },
  {
    key: "l",
    label: "A light of your own (L)",
    toggle: true,
    splats: false,
    icon: "M10 3a7 7 0 1 0 0 14a7 7 0 1 0 0-14M10 3v14M12.5 3.6v12.8M15 5.2v9.6"
  },
  {key: "i", label: "Statistics (I)", toggle: true, wide: true, icon: "M3 17V3M3 17h14M7 14v-4M11 14V6M15 14V9"},
  {key: "p", label: "Save a picture (P)", icon: "M3 6h3l1.5-2h5L14 6h3v10H3zM7 11a3 3 0 1 0 6 0a3 3 0 1 0-6 0"},
  {
    key: "v",
    label: "Copy a link to this view (V)",
    icon: "M8.5 11.5l3-3M7 9l-2 2a3 3 0 0 0 4 4l2-2M9 7l2-2a3 3 0 0 1 4 4l-2 2"
  },
  {
    key: "g",
    label: "Settings (G)",
    icon: "M10 7a3 3 0 1 0 0 6a3 3 0 1 0 0-6M10 2v3M10 15v3M2 10h3M15 10h3M4.3 4.3l2.1 2.1M13.6 13.6l2.1 2.1" +
        "M4.3 15.7l2.1-2.1M13.6 6.4l2.1-2.1"
  },
  {key: "h", label: "Help (H)", icon: "M7 7.5a3 3 0 1 1 4.5 2.6c-1 .6-1.5 1.1-1.5 2.4M10 15.6v.2"},
];

/// `press(key)` acts as if the key had been pressed. `splats`: the page shows splats.
export function makeTools(nav, splats, press) {
  for (const {key, label, toggle, wide, splats: forSplats, icon} of kTools) {
    if (forSplats !== undefined && forSplats !== splats) continue;
    const button = element(
        "button", {
          type: "button",
          id: `tool-${key}`,
          title: label,
          className: wide ? "wide" : "",
          onclick: () => press(key),
        },
        svgElement("svg", {viewBox: "0 0 20 20"}, svgElement("path", {d: icon})));
    button.setAttribute("aria-label", label);
    if (toggle) button.setAttribute("aria-pressed", "false");
    nav.append(button);
  }
}
