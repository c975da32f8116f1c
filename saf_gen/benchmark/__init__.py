"""From streams to records: focus methods run on recordings or on a running camera, and their answers are judged."""
