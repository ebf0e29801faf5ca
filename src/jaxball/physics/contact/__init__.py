"""The contact of a body with its ground: the law of friction and impact, and the motion that rolls, slides and flies.

:class:`~jaxball.physics.contact.body_on_plane.BodyOnPlane` fulfils the contract of hybrid systems, and nothing outside
this folder knows its modes, except what shows them.
"""
