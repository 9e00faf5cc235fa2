"""The ledger of the scripted vehicle: a tilted floor, a push and a drift, in the words of a page process.

The package judges the faults that a browser requests, and refuses unknown faults.
"""

from typing import Any

from baqueano.messages import text
from baqueano.messages.language import use_language
from baqueano.worlds.faults.fault import Fault


def ledger(language: str) -> dict[str, Any]:
    """Return the faults of the vehicle and their detections."""
    k = 0 if language == "en" else 1

    def fault(kind: str, **values: Any) -> dict[str, Any]:
        return {
            "kind": kind,
            "target": "",
            "x": 0.0,
            "y": 0.0,
            "size": 0.0,
            "part": 0.0,
            "frame": "map",
        } | values

    rows = [
        (44.0, None, fault("tilt", x=0.025, y=0.02),
         ("floor tilted by 1.8°, up towards 39°", "piso inclinado 1,8°, sube hacia 39°"), [],
         ("for 16.0 s: NIS at most 1.02. The estimate is 1.4 cm off and believes ± 5.3 cm. An accelerometer shows a "
          "tilt as it shows a bias, and nothing else measures it.",
          "durante 16,0 s: NIS a lo sumo 1,02. La estimación se equivoca en 1,4 cm y cree estar a ± 5,3 cm. Un "
          "acelerómetro muestra una inclinación igual que un sesgo, y nada más la mide.")),
        (51.2, 51.25, fault("push", x=0.11, y=-0.05),
         ("push of 0.12 N s to the left", "empujón de 0,12 N s hacia la izquierda"),
         [("NIS", 0.02, ("its mean over 1 s is 2.63; chance gives at most 1.33",
                         "su media en 1 s es 2,63; el azar da a lo sumo 1,33")),
          (("gate", "compuerta")[k], 0.03, ("refused 3 innovations within 1 s",
                                            "rechazó 3 innovaciones en 1 s"))], None),
        (55.0, None, fault("drift", target="imu[2]", size=0.15),
         ("zero of imu[2] drifts by 0.15 rad/s", "el cero de imu[2] deriva 0,15 rad/s"), [],
         ("for 5.0 s: NIS at most 1.05. No other sensor shows this motion, so nothing contradicts imu[2].",
          "durante 5,0 s: NIS a lo sumo 1,05. Ningún otro sensor muestra este movimiento, así que nada contradice a "
          "imu[2].")),
    ]  # fmt: skip
    return {"type": "ledger", "rows": [
        {"number": n, "t_s": t_s, "until_s": until_s, "ended": until_s is not None, "fault": of, "text": subject[k],
         "detections": [{"detector": detector, "after_s": after_s, "text": text[k]}
                        for detector, after_s, text in detections],
         "missed_by": ["monitor", "supervisor"], "undetected": misses and misses[k]}
        for n, (t_s, until_s, of, subject, detections, misses) in enumerate(rows, 1)
    ]}  # fmt: skip


class Faults:
    """Faults of a drive in a ledger without detections."""

    def __init__(self) -> None:
        self.rows: list[dict[str, Any]] = []

    def take(self, word: dict[str, Any], t_s: float, language: str) -> dict[str, Any]:
        """Begin or end a fault, and return the message `ledger`."""
        if "end" in word:
            self.rows[word["end"] - 1] |= {"ended": True, "until_s": t_s}
        else:
            fields = {name: value for name, value in word.items() if name not in ("type", "robot")}
            fault, number = Fault.parse(fields | {"start_s": t_s}), len(self.rows) + 1
            with use_language(language):
                subject = text(fault.message(number))
            self.rows.append({
                "number": number, "t_s": t_s, "until_s": None, "ended": fault.kind == "push", "fault": fault.to_json(),
                "text": subject, "detections": [], "missed_by": [], "undetected": None,
            })  # fmt: skip
        return {"type": "ledger", "rows": self.rows}
