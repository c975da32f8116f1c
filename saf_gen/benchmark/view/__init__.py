"""Views through which a method sees a recording, or sees a running camera and moves its lens."""
