"""From a scene, a rig and a rate to the smallest loop that renders it."""
