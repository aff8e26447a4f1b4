"""Recordings of mechanisms with concealed effects, to test any diagnosis with: made in MuJoCo, never by the engine that diagnoses, answers kept apart.

mechanism -> laws -> recorded -> draw -> make, with floating, ground and thrown between recorded and draw where nothing holds the base; spike (known
alterations of measured recordings); score (any diagnoser), beside compare (other corrections of the simulator). Nothing that makes cases knows the diagnosis
or its simulator: MuJoCo moves the bodies of a case's URDF in steps of 0.5 ms (semi-implicit Euler), and every effect's law is written out anew.
"""
