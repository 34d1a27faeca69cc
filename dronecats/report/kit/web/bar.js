// The bar on top of a page: the theme, light, dark or as the system has it, and the way past the bar.
// The browser keeps the choice, for a page on a disk too.

const NEXT = { auto: "dark", dark: "light", light: "auto" };
const KEPT = "dronecats-theme";

function kept() {
  try {
    return localStorage.getItem(KEPT) || "auto";
  } catch {
    return "auto";
  }
}

function wear(theme) {
  const known = NEXT[theme] ? theme : "auto";
  if (known === "auto") delete document.documentElement.dataset.theme;
  else document.documentElement.dataset.theme = known;
  const button = document.getElementById("theme");
  button.textContent = { auto: "◐", dark: "●", light: "○" }[known];
  button.title = `Theme: ${known}`;
  button.setAttribute("aria-label", `Theme: ${known}. Change it`);
  button.hidden = false;
  try {
    localStorage.setItem(KEPT, known);
  } catch {
    // a browser that keeps nothing shows what the system has when it opens
  }
}

export function nextTheme() {
  wear(NEXT[kept()] || "auto");
}

document.getElementById("theme").addEventListener("click", nextTheme);
document.getElementById("skip").addEventListener("click", () => document.getElementById("main").focus());
wear(kept());
