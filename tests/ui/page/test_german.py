"""The page in German: every screen and its dialogs, and the language that a person chose."""

from __future__ import annotations

import re
from typing import Any

import msgspec
from playwright.sync_api import Browser, Page, expect

from agribot.core.fact_text import render, render_apart
from agribot.core.facts import DiskFree, Fact, ProgramSilent, StoppedBy, StopToClear
from agribot.ui import wire
from tests.ui.page.conftest import SCREENS, WITHOUT_GL, new_context, show, until
from tests.ui.page.fake_answers import HEALTH
from tests.ui.page.fake_server import FakeServer

# Words that are English and no German ones.
ENGLISH = re.compile(
    r"\b(?:the|of|and|is|are|with|to|for|from|this|its|that|it|no|not yet|by|at|on|off|row|rows"
    r"|robot|field|stop|done|clear|take|open|close|save)\b",
    re.IGNORECASE,
)
# What shows that a screen has its data.
FILLED = {"settings": ".setting", "health": ".check-card", "recordings": "tbody tr"}
# What stands in the page in its own language, and the names that read aloud what is drawn.
READ = """() => {
  const isOurs = (node) => !node.closest('[lang=en], [hidden], .mono, script, style')
  const texts = []
  const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT)
  while (walk.nextNode())
    if (isOurs(walk.currentNode.parentElement)) texts.push(walk.currentNode.data)
  for (const name of ['aria-label', 'title', 'placeholder', 'alt'])
    for (const node of document.querySelectorAll(`[${name}]`))
      if (isOurs(node)) texts.push(node.getAttribute(name))
  return texts.map((text) => text.trim()).filter(Boolean)
}"""


def show_german(name: str, fact: Fact) -> wire.HealthCheck:
    text, advice = render_apart(fact, "de")
    return wire.HealthCheck(name=name, state="warn", text=text, advice=advice, value=None)


def open_german(browser: Browser, server: FakeServer, **options: Any) -> Page:
    page = new_context(browser, locale="de-DE", **options).new_page()
    page.goto(f"{server.address}/?{WITHOUT_GL}")
    until(page, "window.__agribot?.ready")
    return page


def find_english(page: Page) -> list[str]:
    texts: list[str] = page.evaluate(READ)
    assert len(texts) > 10
    return [text for text in texts if ENGLISH.search(text)]


def test_no_screen_and_no_dialog_shows_an_english_sentence_in_german(
    browser: Browser, server: FakeServer
) -> None:
    server.robot.stop = render(StopToClear(StoppedBy("Ann")), "de")
    checks = [
        show_german("control loop", ProgramSilent(1.25)),
        show_german("disk", DiskFree(0.5, is_low=True)),
    ]
    server.answers["health"] = msgspec.structs.replace(HEALTH, checks=checks)
    page = open_german(browser, server)
    assert page.evaluate("document.documentElement.lang") == "de"
    found = {}
    for screen in SCREENS:
        show(page, screen)
        page.locator(FILLED.get(screen, ".screen > *")).first.wait_for()
        found[screen] = find_english(page)
    page.locator(".operator").click()
    expect(page.get_by_role("dialog")).to_contain_text("Niemand steuert den Roboter.")
    found["seat"] = find_english(page)
    page.context.close()
    assert found == {name: [] for name in found}


def test_the_language_is_chosen_in_the_settings_and_kept(
    browser: Browser, server: FakeServer
) -> None:
    page = open_german(browser, server)
    show(page, "settings")
    page.get_by_label("Sprache").select_option("English")
    expect(page.get_by_role("heading", name="This page")).to_be_visible()
    page.reload()
    expect(page.get_by_role("heading", name="This page")).to_be_visible()
    assert page.evaluate("document.documentElement.lang") == "en"
    page.context.close()
