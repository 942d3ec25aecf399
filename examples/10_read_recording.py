"""Read a recorded drive: what the robot saw, decided and how old its picture was."""

import sys
from pathlib import Path

import cv2
import numpy as np
from folder import out

from robot.contract import Action
from robot.recording.reader import read_turns
from sim_pybullet.show import sheet

golden = Path(__file__).parents[1] / "tests" / "data" / "golden_drive.mcap"
drive = Path(sys.argv[2]) if len(sys.argv) > 2 else golden

shown, actions = [], []
for turn, frame in read_turns(drive):
    if turn.action is None or frame is None:
        continue
    actions.append(Action(turn.action).name)
    if len(actions) % 8 == 1:
        picture = cv2.resize(frame, (320, 240), interpolation=cv2.INTER_NEAREST)
        text = f"{turn.state} {actions[-1].lower()}"
        cv2.putText(picture, text, (6, 18), 0, 0.5, (255, 60, 60), 1, cv2.LINE_AA)
        shown.append(picture)
counts = {name: actions.count(name) for name in dict.fromkeys(actions)}
print(f"{drive.name}: {len(actions)} decisions, {counts}")
cv2.imwrite(str(out / "10_read_recording.png"), sheet(np.array(shown[:12]))[..., ::-1])
