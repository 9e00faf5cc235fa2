"""English sentences for messages that are alike, and are said once."""

TEMPLATES: dict[str, str] = {
    "messages.others": "{first} (so also {others})",
    "messages.times": "{first} ({times} times)",
}
