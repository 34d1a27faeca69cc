// The bar on top of a page: the theme (light, dark, or the system's) and the link that skips the bar.
// The browser stores the choice, for a page on a disk too.

const NEXT = { auto: "dark", dark: "light", light: "auto" };
const STORAGE_KEY = "dronecats-theme";

function storedTheme() {
  try {
    return localStorage.getItem(STORAGE_KEY) || "auto";
  } catch {
    return "auto";
  }
}

function applyTheme(theme) {
  const valid = NEXT[theme] ? theme : "auto";
  if (valid === "auto") delete document.documentElement.dataset.theme;
  else document.documentElement.dataset.theme = valid;
  const button = document.getElementById("theme");
  button.textContent = { auto: "◐", dark: "●", light: "○" }[valid];
  button.title = `Theme: ${valid}`;
  button.setAttribute("aria-label", `Theme: ${valid}. Change it`);
  button.hidden = false;
  try {
    localStorage.setItem(STORAGE_KEY, valid);
  } catch {
    // without storage the page opens with the system's theme
  }
}

export function nextTheme() {
  applyTheme(NEXT[storedTheme()] || "auto");
}

document.getElementById("theme").addEventListener("click", nextTheme);
document.getElementById("skip").addEventListener("click", () => document.getElementById("main").focus());
applyTheme(storedTheme());
