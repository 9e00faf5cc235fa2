"""English sentences of messages about messages: names that are not known, and messages that are alike."""

TEMPLATES: dict[str, str] = {
    "name.near": "Did you mean {meant}? The names are {known}",
    "name.none": "The list of names is empty here",
    "name.unknown": "The names are {known}",
    "messages.others": "{first} (so also {others})",
    "messages.then": "{first}. {then}.",
    "messages.times": "{first} ({times} times)",
}
