// Where users log in and out.
"use strict";

const byId = (id) => document.getElementById(id);

async function ask(path, body) {
  byId("answer").textContent = "";
  try {
    const answer = await fetch(path, { method: "POST", body: JSON.stringify(body) });
    if (answer.ok) location.replace("/");
    else byId("answer").textContent = (await answer.json()).error.message;
  } catch {
    byId("answer").textContent = "the page's own server does not answer";
  }
}

byId("login").addEventListener("submit", (event) => {
  event.preventDefault();
  ask("/api/login", { name: byId("name").value, password: byId("password").value });
});
byId("logout").addEventListener("click", () => ask("/api/logout", {}));
