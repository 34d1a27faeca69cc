// Light, dark, or as the system has it. What was chosen stays where the browser keeps things for a page on a disk.

const NEXT = { auto: "dark", dark: "light", light: "auto" };
const KEPT = "dronecats-theme";

export function kept() {
  try {
    return localStorage.getItem(KEPT) || "auto";
  } catch {
    return "auto";
  }
}

export function wear(theme) {
  const known = NEXT[theme] ? theme : "auto";
  if (known === "auto") delete document.documentElement.dataset.theme;
  else document.documentElement.dataset.theme = known;
  const button = document.getElementById("theme");
  button.textContent = { auto: "◐", dark: "●", light: "○" }[known];
  button.title = `Theme: ${known} (t)`;
  button.setAttribute("aria-label", `Theme: ${known}. Change it`);
  try {
    localStorage.setItem(KEPT, known);
  } catch {
    // a browser that keeps nothing shows what the system has when it opens
  }
}

export function nextTheme() {
  wear(NEXT[kept()] || "auto");
}
